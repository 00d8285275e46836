// Where vehicles say that they are, or were when they were last heard.
import { MapView } from "../src/mapview.js";
import { colours } from "../src/theme.js";
import { Chart } from "./chart.js";
import { Plane } from "./place.js";

export const FRESH_S = 2; // as companion/watch/heard.py
// As it tells, or, without satellites, as it reckons from its leader.
export const placeOf = (one) => one.place ?? one.reckoned ?? null;
const REACH_PX = 30; // of a finger
const LINE_PX = 18; // of a label

export class WatchMap extends MapView {
  constructor(canvas, picked) {
    super(canvas, { start: 0 }, {}, picked);
    this.plane = null;
    this.chart = null;
    this.told = null;
    this.followed = true; // until somebody moves the map
    this.fitted = false;
  }

  update(told) {
    this.told = told;
    const { about, vehicles } = told;
    const first = about.mission?.places[0].at ?? vehicles.map(placeOf).find(Boolean) ?? middle(about.chart);
    if (!this.plane && first) this.plane = new Plane(first[0], first[1]);
    if (!this.chart && about.chart && this.plane) this.chart = new Chart(about.chart, () => this.draw());
    this.draw();
  }

  pan(dx, dy) {
    this.followed = false;
    super.pan(dx, dy);
  }

  zoom(...how) {
    this.followed = false;
    super.zoom(...how);
  }

  vehiclesAt() {
    return [...this.told.vehicles, ...this.told.told].map(placeOf).filter(Boolean).map((place) => this.plane.enu(place));
  }

  everything() {
    const { mission } = this.told.about;
    const places = mission ? [...mission.places.map((one) => one.at), ...mission.fence] : [];
    return [...this.vehiclesAt(), ...places.map((place) => this.plane.enu(place))];
  }

  fit(points = this.told && this.plane ? this.everything() : []) {
    this.view = { east: 0, north: 0, scale: 2 };
    this.fitted = points.length > 0;
    if (!points.length) return;
    const [e, n] = [points.map(([east]) => east), points.map(([, north]) => north)];
    const [west, east, south, north] = [Math.min(...e), Math.max(...e), Math.min(...n), Math.max(...n)];
    const room = (px) => Math.max(60, px - 110);
    const scale = Math.min(room(this.width) / Math.max(20, east - west), room(this.height) / Math.max(20, north - south));
    this.view = { east: (west + east) / 2, north: (south + north) / 2, scale: Math.min(30, scale) };
  }

  holdsAll() {
    if (!this.view || !this.fitted) return false;
    return this.vehiclesAt().every(([e, n]) => {
      const [x, y] = [this.x(e), this.y(n)];
      return x > 30 && y > 30 && x < this.width - 30 && y < this.height - 30;
    });
  }

  follow() {
    this.followed = true;
    if (this.told && this.plane) this.fit(this.vehiclesAt());
    this.draw();
  }

  whole() {
    this.followed = false;
    this.fit();
    this.draw();
  }

  draw() {
    const { canvas } = this;
    if (!this.width || !this.height) return;
    const ratio = window.devicePixelRatio || 1;
    const [wide, high] = [Math.round(this.width * ratio), Math.round(this.height * ratio)];
    if (canvas.width !== wide || canvas.height !== high) [canvas.width, canvas.height] = [wide, high];
    if (this.followed && this.plane && !this.holdsAll()) this.fit(this.vehiclesAt());
    if (!this.view) this.fit();
    const pen = (this.pen = canvas.getContext("2d"));
    this.ink = colours();
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.fillStyle = this.ink.ground;
    pen.fillRect(0, 0, this.width, this.height);
    pen.font = "600 16px system-ui, sans-serif";
    pen.textBaseline = "middle";
    this.labels = []; // where some are already
    if (!this.plane) return;
    if (this.chart) this.chart.draw(pen, this, this.plane);
    else this.grid();
    if (this.told.about.mission) this.mission(this.told.about.mission);
    const at = new Map(this.told.vehicles.filter(placeOf).map((one) => [one.id, this.plane.enu(placeOf(one))]));
    for (const one of this.told.vehicles) if (at.has(one.id) && at.has(one.parent)) this.follows(one, at.get(one.id), at.get(one.parent));
    for (const one of this.told.told) if (one.place) this.toldOf(one);
    for (const one of this.told.vehicles) if (at.has(one.id)) this.vehicle(one, at.get(one.id));
    this.scaleBar();
  }

  step(px) {
    const wanted = px / this.view.scale;
    const power = 10 ** Math.floor(Math.log10(wanted));
    return power * [1, 2, 5, 10].find((times) => times * power >= wanted * 0.99);
  }

  grid() {
    const { pen, view } = this;
    const step = this.step(80);
    pen.strokeStyle = this.ink.grid;
    pen.lineWidth = 1;
    pen.beginPath();
    for (let e = Math.ceil((view.east - this.width / 2 / view.scale) / step) * step; this.x(e) < this.width; e += step) {
      pen.moveTo(this.x(e), 0);
      pen.lineTo(this.x(e), this.height);
    }
    for (let n = Math.ceil((view.north - this.height / 2 / view.scale) / step) * step; this.y(n) > 0; n += step) {
      pen.moveTo(0, this.y(n));
      pen.lineTo(this.width, this.y(n));
    }
    pen.stroke();
  }

  mission({ fence, places }) {
    const { pen } = this;
    pen.strokeStyle = this.ink.alarm;
    pen.lineWidth = 3;
    pen.setLineDash([10, 6]);
    pen.beginPath();
    fence.map((at) => this.plane.enu(at)).forEach(([e, n], k) => pen[k ? "lineTo" : "moveTo"](this.x(e), this.y(n)));
    pen.closePath();
    pen.stroke();
    pen.setLineDash([]);
    for (const { name, at } of places) {
      const [e, n] = this.plane.enu(at);
      const [x, y] = [this.x(e), this.y(n)];
      pen.strokeStyle = this.ink.ink;
      pen.beginPath();
      pen.moveTo(x - 8, y);
      pen.lineTo(x + 8, y);
      pen.moveTo(x, y - 8);
      pen.lineTo(x, y + 8);
      pen.stroke();
      this.label(name, x, y + 20);
    }
  }

  // The neighbour that it says it follows.
  follows(one, [e, n], [pe, pn]) {
    const { pen } = this;
    pen.strokeStyle = this.ink.link;
    pen.lineWidth = 2;
    pen.setLineDash(one.age_s < FRESH_S ? [] : [3, 7]);
    pen.beginPath();
    pen.moveTo(this.x(e), this.y(n));
    pen.lineTo(this.x(pe), this.y(pn));
    pen.stroke();
    pen.setLineDash([]);
  }

  vehicle(one, [e, n]) {
    const { pen, ink } = this;
    const [x, y] = [this.x(e), this.y(n)];
    const fresh = one.age_s < FRESH_S;
    const leads = one.acting && one.leader === one.id;
    if (fresh && one.airborne) {
      const [north, east] = one.vel_ned_mps;
      pen.strokeStyle = ink.ink;
      pen.lineWidth = 3;
      pen.beginPath();
      pen.moveTo(x, y);
      pen.lineTo(x + 3 * east * this.view.scale, y - 3 * north * this.view.scale); // of the next three seconds
      pen.stroke();
    }
    if (!one.place && one.leader_sd_m) {
      pen.strokeStyle = ink.accent; // how sure it is, twice
      pen.lineWidth = 2;
      pen.beginPath();
      pen.arc(x, y, Math.max(18, 2 * one.leader_sd_m * this.view.scale), 0, 2 * Math.PI);
      pen.stroke();
    }
    // Told apart by shape: the leader is a diamond, a ghost is hollow and dashed
    pen.beginPath();
    if (leads) {
      for (const [dx, dy] of [[0, -19], [19, 0], [0, 19], [-19, 0]]) pen.lineTo(x + dx, y + dy);
      pen.closePath();
    } else pen.arc(x, y, 14, 0, 2 * Math.PI);
    pen.fillStyle = fresh ? (leads ? ink.leader : ink.accent) : ink.ground;
    pen.fill();
    pen.setLineDash(fresh ? [] : [5, 4]);
    pen.lineWidth = one.id === this.selected ? 5 : 3;
    pen.strokeStyle = fresh ? ink.ground : ink.alarm;
    if (one.id === this.selected) pen.strokeStyle = ink.ink;
    pen.stroke();
    pen.setLineDash([]);
    pen.textAlign = "center";
    pen.fillStyle = fresh ? ink.ground : ink.ink;
    pen.fillText(String(one.id), x, y + 1);
    if (!fresh) this.label(`${age(one.age_s)} ago`, x + 22, y, "left");
  }

  // What another vehicle tells of one that fell silent.
  toldOf(one) {
    const { pen } = this;
    const [e, n] = this.plane.enu(one.place);
    const [x, y] = [this.x(e), this.y(n)];
    pen.strokeStyle = this.ink.warn;
    pen.lineWidth = 3;
    pen.beginPath();
    for (const [dx, dy] of [[0, -20], [20, 16], [-20, 16]]) pen.lineTo(x + dx, y + dy);
    pen.closePath();
    pen.stroke();
    this.label(`${one.id}, says ${one.by}`, x, y + 32);
  }

  label(text, x, wanted, align = "center") {
    const { pen } = this;
    pen.textAlign = align;
    const y = this.freeFor(pen.measureText(text).width, x, wanted, align);
    pen.lineWidth = 5;
    pen.lineJoin = "round";
    pen.strokeStyle = this.ink.ground;
    pen.strokeText(text, x, y);
    pen.fillStyle = this.ink.ink;
    pen.fillText(text, x, y);
  }

  // The height nearest to the one wanted where no other label is.
  freeFor(width, x, wanted, align) {
    const left = align === "left" ? x : x - width / 2;
    const beside = (y) => this.labels.every((one) => one.right < left || one.left > left + width || Math.abs(one.y - y) >= LINE_PX);
    const inside = (y) => y >= LINE_PX / 2 && y <= this.height - LINE_PX / 2;
    const y = [0, -1, 1, -2, 2].map((lines) => wanted + lines * LINE_PX).find((one) => inside(one) && beside(one)) ?? wanted;
    this.labels.push({ left, right: left + width, y });
    return y;
  }

  scaleBar() {
    const { pen } = this;
    const metres = this.step(100);
    const px = metres * this.view.scale;
    const [x, y] = [14, this.height - 16];
    for (const [width, ink] of [[8, this.ink.ground], [4, this.ink.ink]]) {
      pen.lineWidth = width;
      pen.strokeStyle = ink;
      pen.beginPath();
      pen.moveTo(x, y);
      pen.lineTo(x + px, y);
      pen.stroke();
    }
    this.label(`${metres} m`, x + px + 8, y, "left");
  }

  pick(px, py) {
    let [best, least] = [null, REACH_PX];
    for (const one of this.told?.vehicles ?? []) {
      if (!placeOf(one)) continue;
      const [e, n] = this.plane.enu(placeOf(one));
      const away = Math.hypot(this.x(e) - px, this.y(n) - py);
      if (away < least) [best, least] = [one.id, away];
    }
    this.picked(best);
  }
}

function middle(chart) {
  if (chart?.corners_deg) return chart.corners_deg[0];
  const [west, south, east, north] = chart?.bounds_deg ?? [];
  return west === undefined ? null : [(south + north) / 2, (west + east) / 2];
}

export function age(seconds) {
  if (seconds < 10) return `${seconds.toFixed(1)} s`;
  return seconds < 100 ? `${Math.round(seconds)} s` : `${Math.round(seconds / 60)} min`;
}
