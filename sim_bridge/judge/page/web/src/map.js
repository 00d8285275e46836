// The flight from above.
import { colours, vehicleColour } from "./theme.js";
import { MapView } from "./mapview.js";
import { reach } from "./shadow.js";
import { SCAN_ROWS, upTo } from "./replay.js";

const TRAIL_S = 12;
const ROUND_FROM_PX = 1.5; // of a radius: below, a square looks the same
const CROWNS_FROM_PX = 2; // px for a metre: further out crowns would be a carpet

export class Map2D extends MapView {
  draw() {
    const { canvas, replay, layers } = this;
    if (!this.width || !this.height) return;
    const ratio = window.devicePixelRatio || 1;
    const [wide, high] = [Math.round(this.width * ratio), Math.round(this.height * ratio)];
    if (canvas.width !== wide || canvas.height !== high) [canvas.width, canvas.height] = [wide, high];
    if (!this.view) this.fit();
    const at = replay.at(this.time);
    if (layers.follow) this.follow(at);
    const pen = canvas.getContext("2d");
    this.pen = pen;
    this.ink = colours();
    pen.setTransform(1, 0, 0, 1, 0, 0);
    pen.drawImage(this.standing(wide, high, ratio), 0, 0);
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.lineJoin = "round";
    this.scenery(at);
    if (!replay.time.length) return;
    if (layers.ranges) this.ranges(at);
    if (layers.trails) this.trails(at);
    if (layers.links) this.links(at);
    if (layers.scans) this.scans(at);
    this.vehicles(at);
    this.scaleBar();
  }

  // Ground, grid and forest: drawn when the view changes, and not for each frame.
  standing(wide, high, ratio) {
    const { east, north, scale } = this.view;
    const key = [wide, high, east, north, scale, this.layers.crowns].join();
    if (this.stood?.key === key && this.stood.ink === this.ink) return this.stood.canvas;
    const canvas = this.stood?.canvas ?? document.createElement("canvas");
    [canvas.width, canvas.height] = [wide, high];
    this.stood = { canvas, key, ink: this.ink };
    const { pen } = this;
    this.pen = canvas.getContext("2d");
    this.pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    this.pen.fillStyle = this.ink.ground;
    this.pen.fillRect(0, 0, this.width, this.height);
    this.grid();
    this.forest();
    this.pen = pen;
    return canvas;
  }

  follow(at) {
    const seen = this.replay.vehicles.map((one, k) => (one.alive[at.row] ? this.replay.place(k, at) : null)).filter(Boolean);
    if (!seen.length) return;
    this.view.east = seen.reduce((sum, p) => sum + p[0], 0) / seen.length;
    this.view.north = seen.reduce((sum, p) => sum + p[1], 0) / seen.length;
  }

  metres(wantedPx) {
    const wanted = wantedPx / this.view.scale;
    const power = 10 ** Math.floor(Math.log10(wanted));
    return power * [1, 2, 5, 10].find((step) => step * power >= wanted * 0.99);
  }

  grid() {
    const { pen, view } = this;
    const step = this.metres(90);
    pen.strokeStyle = this.ink.grid;
    pen.lineWidth = 1;
    pen.beginPath();
    const [halfE, halfN] = [this.width / 2 / view.scale, this.height / 2 / view.scale];
    for (let e = Math.ceil((view.east - halfE) / step) * step; e <= view.east + halfE; e += step) {
      pen.moveTo(Math.round(this.x(e)) + 0.5, 0);
      pen.lineTo(Math.round(this.x(e)) + 0.5, this.height);
    }
    for (let n = Math.ceil((view.north - halfN) / step) * step; n <= view.north + halfN; n += step) {
      pen.moveTo(0, Math.round(this.y(n)) + 0.5);
      pen.lineTo(this.width, Math.round(this.y(n)) + 0.5);
    }
    pen.stroke();
  }

  forest() {
    const { trees, bushes } = this.replay;
    if (this.layers.crowns && this.view.scale >= CROWNS_FROM_PX) {
      this.discs(trees, this.ink.crown, (i) => (trees.height_m[i] > trees.crown_base_m[i] ? trees.crown_radius_m[i] : 0), 0);
    }
    this.discs(bushes, this.ink.bush, (i) => bushes.radius_m[i], 0);
    this.discs(trees, this.ink.trunk, (i) => trees.radius_m[i], 1.3);
  }

  discs(table, colour, radius, leastPx) {
    const { pen, view } = this;
    pen.fillStyle = colour;
    pen.beginPath();
    for (let i = 0; i < table.east_m.length; i++) {
      const metres = radius(i);
      if (metres <= 0) continue;
      const px = Math.max(leastPx, metres * view.scale);
      const [x, y] = [this.x(table.east_m[i]), this.y(table.north_m[i])];
      if (x < -px || y < -px || x > this.width + px || y > this.height + px) continue;
      if (px < ROUND_FROM_PX) {
        pen.rect(x - px, y - px, 2 * px, 2 * px);
        continue;
      }
      pen.moveTo(x + px, y);
      pen.arc(x, y, px, 0, 2 * Math.PI);
    }
    pen.fill();
  }

  line(points, closed = false) {
    const { pen } = this;
    pen.beginPath();
    points.forEach(([e, n], i) => (i ? pen.lineTo(this.x(e), this.y(n)) : pen.moveTo(this.x(e), this.y(n))));
    if (closed) pen.closePath();
  }

  scenery(at) {
    const { pen } = this;
    const { mission, swarm } = this.replay;
    if (mission.fence_enu_m.length) {
      this.line(mission.fence_enu_m, true);
      pen.strokeStyle = this.ink.alarm;
      pen.setLineDash([2, 4]);
      pen.lineWidth = 1.2;
      pen.stroke();
    }
    pen.setLineDash([6, 4]);
    pen.strokeStyle = this.ink.faint;
    for (const [e, n] of mission.coverage.centres_enu_m) {
      pen.beginPath();
      pen.arc(this.x(e), this.y(n), mission.coverage.radius_m * this.view.scale, 0, 2 * Math.PI);
      pen.stroke();
    }
    pen.setLineDash([]);
    if (this.layers.coverage && swarm.phase[at.row] === 3) this.covered(at);
    pen.fillStyle = this.ink.ink;
    pen.strokeStyle = this.ink.ink;
    pen.font = "600 13px system-ui, sans-serif";
    for (const { name, enu_m: [e, n] } of mission.places) {
      const [x, y] = [this.x(e), this.y(n)];
      pen.lineWidth = 1.5;
      pen.beginPath();
      pen.moveTo(x - 5, y);
      pen.lineTo(x + 5, y);
      pen.moveTo(x, y - 5);
      pen.lineTo(x, y + 5);
      pen.stroke();
      pen.fillText(name, x + 7, y + 15);
    }
  }

  // What each vehicle on the ring covers, half-way to its neighbours, and the largest gap.
  covered(at) {
    const { pen, replay } = this;
    const { coverage } = replay.mission;
    if (coverage.shape !== "ring") return;
    const [e0, n0] = coverage.centres_enu_m.at(-1);
    const angles = replay.vehicles
      .map((one, k) => ({ k, alive: one.alive[at.row] && !one.on_ground[at.row], place: replay.place(k, at) }))
      .filter(({ alive, place }) => alive && Math.hypot(place[0] - e0, place[1] - n0) > coverage.radius_m * 0.5)
      .map(({ place }) => Math.atan2(place[1] - n0, place[0] - e0))
      .sort((a, b) => a - b);
    if (angles.length < 2) return;
    let gap = { size: 0, from: 0 };
    angles.forEach((angle, i) => {
      const next = i + 1 < angles.length ? angles[i + 1] : angles[0] + 2 * Math.PI;
      if (next - angle > gap.size) gap = { size: next - angle, from: angle };
    });
    const radius = coverage.radius_m * this.view.scale;
    pen.strokeStyle = this.ink.warn;
    pen.lineWidth = 4;
    pen.globalAlpha = 0.7;
    pen.beginPath();
    pen.arc(this.x(e0), this.y(n0), radius, -gap.from, -(gap.from + gap.size), true);
    pen.stroke();
    pen.globalAlpha = 1;
    const middle = gap.from + gap.size / 2;
    pen.fillStyle = this.ink.ink;
    pen.font = "12px system-ui, sans-serif";
    pen.textAlign = "center";
    const far = radius + 18;
    pen.fillText(`gap ${Math.round((gap.size * 180) / Math.PI)}°`, this.x(e0) + far * Math.cos(middle), this.y(n0) - far * Math.sin(middle));
    pen.textAlign = "start";
  }

  // Of the selected vehicle, else of the leader.
  ranges(at) {
    const { pen, replay } = this;
    const k = this.selected ?? replay.swarm.leader[at.row] - 1;
    if (k < 0 || !replay.vehicles[k].alive[at.row]) return;
    const [east, north] = replay.place(k, at);
    const range = replay.vehicles[k].range_m[at.row];
    const kept = replay.mission.kept_per_trunk;
    pen.fillStyle = this.ink.radio;
    pen.strokeStyle = this.ink.radioEdge;
    pen.lineWidth = 1;
    this.line(reach(replay.trees, east, north, range, kept), true);
    pen.fill();
    pen.globalAlpha = kept < 1 ? 0.3 : 1; // trunks make it ragged
    pen.stroke();
    pen.globalAlpha = 1;
    if (kept < 1) {
      pen.setLineDash([1, 5]);
      pen.beginPath();
      pen.arc(this.x(east), this.y(north), range * this.view.scale, 0, 2 * Math.PI);
      pen.stroke();
      pen.setLineDash([]);
    }
  }

  trails(at) {
    const { pen, replay } = this;
    const whole = this.layers.tracks;
    const from = whole ? 0 : upTo(replay.time, this.time - TRAIL_S);
    const stride = whole ? Math.max(1, Math.floor((at.row - from) / 1500)) : 1;
    replay.vehicles.forEach((one, k) => {
      pen.strokeStyle = vehicleColour(k, replay.vehicles.length);
      pen.globalAlpha = this.dimmed(k) ? 0.25 : 0.8;
      pen.lineWidth = 1.6;
      pen.beginPath();
      for (let row = from; row <= at.row; row += stride) {
        const [x, y] = [this.x(one.east_m[row]), this.y(one.north_m[row])];
        if (row === from) pen.moveTo(x, y);
        else pen.lineTo(x, y);
      }
      const [east, north] = replay.place(k, at);
      pen.lineTo(this.x(east), this.y(north));
      pen.stroke();
    });
    pen.globalAlpha = 1;
  }

  dimmed(k) {
    return this.selected !== null && this.selected !== k;
  }

  links(at) {
    const { pen, replay } = this;
    const linked = replay.linksAt(at.row);
    const places = replay.vehicles.map((_, k) => replay.place(k, at));
    pen.strokeStyle = this.ink.link;
    for (const own of [false, true]) {
      pen.globalAlpha = own ? 0.9 : Math.min(0.55, Math.max(0.05, 25 / Math.max(1, linked.length)));
      pen.lineWidth = own ? 1.6 : 1;
      pen.beginPath();
      for (const { a, b } of linked) {
        if ((this.selected === a || this.selected === b) !== own) continue;
        pen.moveTo(this.x(places[a][0]), this.y(places[a][1]));
        pen.lineTo(this.x(places[b][0]), this.y(places[b][1]));
      }
      pen.stroke();
    }
    pen.globalAlpha = 1;
  }

  scans(at) {
    const { pen, replay } = this;
    replay.vehicles.forEach((one, k) => {
      if (!one.scans || this.dimmed(k) || !one.alive[at.row]) return;
      const scan = replay.scanAt(k, at.row);
      if (!scan || scan.age > SCAN_ROWS) return;
      const [east, north] = replay.place(k, at);
      pen.strokeStyle = pen.fillStyle = vehicleColour(k, replay.vehicles.length);
      pen.globalAlpha = 0.35;
      pen.lineWidth = 1;
      pen.beginPath();
      for (const [e, n] of scan.points) {
        pen.moveTo(this.x(east), this.y(north));
        pen.lineTo(this.x(e), this.y(n));
      }
      pen.stroke();
      pen.globalAlpha = 1;
      for (const [e, n] of scan.points) pen.fillRect(this.x(e) - 1.5, this.y(n) - 1.5, 3, 3);
    });
  }

  vehicles(at) {
    const { pen, replay } = this;
    const count = replay.vehicles.length;
    const size = count > 50 ? 5 : 7;
    const leader = replay.swarm.leader[at.row] - 1;
    pen.textAlign = "center";
    pen.textBaseline = "middle";
    replay.vehicles.forEach((one, k) => {
      const [east, north] = replay.place(k, at);
      const [x, y] = [this.x(east), this.y(north)];
      const alive = one.alive[at.row];
      if (this.layers.estimates && one.estimate_off && alive) this.estimate(one, at, east, north, k);
      if (k === leader) {
        pen.strokeStyle = this.ink.leader;
        pen.lineWidth = 2.5;
        pen.beginPath();
        pen.arc(x, y, size + 6, 0, 2 * Math.PI);
        pen.stroke();
      }
      if (k === this.selected) {
        pen.strokeStyle = this.ink.ink;
        pen.lineWidth = 1.5;
        pen.strokeRect(x - size - 9, y - size - 9, 2 * size + 18, 2 * size + 18);
      }
      pen.fillStyle = alive ? vehicleColour(k, count) : this.ink.ground;
      pen.strokeStyle = alive ? this.ink.halo : vehicleColour(k, count);
      pen.lineWidth = 1.5;
      this.arrow(x, y, one.yaw_deg ? one.yaw_deg[at.row] : null, size);
      if (!alive) this.cross(x, y, size);
      if (count <= 30 || k === leader || k === this.selected) {
        pen.font = `${k === leader ? "700 " : ""}12px system-ui, sans-serif`;
        pen.strokeStyle = this.ink.halo;
        pen.lineWidth = 3;
        pen.fillStyle = this.ink.ink;
        const label = k === leader ? `${k + 1} leads` : `${k + 1}`;
        pen.strokeText(label, x, y - size - 13);
        pen.fillText(label, x, y - size - 13);
      }
    });
    pen.textAlign = "start";
    pen.textBaseline = "alphabetic";
  }

  arrow(x, y, yaw, size) {
    const { pen } = this;
    pen.beginPath();
    if (yaw === null || Number.isNaN(yaw)) pen.arc(x, y, size, 0, 2 * Math.PI);
    else {
      const angle = (yaw * Math.PI) / 180;
      for (const [turn, far] of [[0, 1.5], [2.4, 1.15], [Math.PI, 0.45], [-2.4, 1.15]]) {
        pen.lineTo(x + far * size * Math.sin(angle + turn), y - far * size * Math.cos(angle + turn));
      }
      pen.closePath();
    }
    pen.fill();
    pen.stroke();
  }

  cross(x, y, size) {
    const { pen } = this;
    pen.strokeStyle = this.ink.alarm;
    pen.lineWidth = 2.5;
    pen.beginPath();
    for (const sign of [-1, 1]) {
      pen.moveTo(x - size, y - sign * size);
      pen.lineTo(x + size, y + sign * size);
    }
    pen.stroke();
  }

  // Where its autopilot believes to be.
  estimate(one, at, east, north, k) {
    const { pen } = this;
    const [dx, dy] = [one.estimate_off.east_m[at.row], one.estimate_off.north_m[at.row]];
    if (Number.isNaN(dx)) return;
    pen.strokeStyle = vehicleColour(k, this.replay.vehicles.length);
    pen.lineWidth = 1.2;
    pen.setLineDash([3, 2]);
    pen.beginPath();
    pen.moveTo(this.x(east), this.y(north));
    pen.lineTo(this.x(east + dx), this.y(north + dy));
    pen.stroke();
    pen.beginPath();
    pen.arc(this.x(east + dx), this.y(north + dy), 6, 0, 2 * Math.PI);
    pen.stroke();
    pen.setLineDash([]);
  }

  scaleBar() {
    const { pen } = this;
    const metres = this.metres(70);
    const px = metres * this.view.scale;
    const [x, y] = [12, this.height - 14];
    pen.strokeStyle = pen.fillStyle = this.ink.ink;
    pen.lineWidth = 1.5;
    pen.beginPath();
    pen.moveTo(x, y - 4);
    pen.lineTo(x, y);
    pen.lineTo(x + px, y);
    pen.lineTo(x + px, y - 4);
    pen.stroke();
    pen.font = "12px system-ui, sans-serif";
    pen.fillText(`${metres} m`, x + 4, y - 6);
  }
}
