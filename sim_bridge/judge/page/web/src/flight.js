// One flight: its map, in 2D and 3D, and what is to be seen on it.
import { el } from "./dom.js";
import { FLIGHT_LAYERS, FlightMap } from "./map/flightmap.js";
import { legendOf } from "./map/layer.js";
import { PHASES } from "./replay.js";
import { vehicleColour } from "./theme.js";

// East and north of the origin and, where it is known where that is, latitude and longitude.
export function positionText([east, north], plane) {
  const metres = `${east.toFixed(1)} m east, ${north.toFixed(1)} m north`;
  return plane ? `${metres} · ${plane.wgs84([east, north]).map((deg) => deg.toFixed(6)).join(", ")}` : metres;
}

const OPTIONS = [{ name: "follow", text: "follow swarm or chosen vehicle", order: 9, shown: false }];

export class FlightView {
  // `under`: what stands between the map and the choice of what it shows.
  constructor(root, replay, clock, under = null) {
    this.replay = replay;
    this.clock = clock;
    this.legend = legendOf(FLIGHT_LAYERS, OPTIONS, replay);
    this.layers = Object.fromEntries(this.legend.map(({ name, shown }) => [name, shown]));
    this.boxes = {}; // of the legend, by layer
    this.selected = null;
    this.scene = null;
    this.flat = el("canvas", {
      class: "view flat",
      tabindex: "0",
      role: "img",
      "aria-label": "the flight in 2D: arrow keys move it, plus and minus zoom, 0 shows all of it",
    });
    this.space = el("div", { class: "view space", hidden: true });
    this.pointer = el("output", { class: "pointer", hidden: true, "aria-live": "off" });
    const credit = el("p", { class: "credit" }, replay.chart?.attribution ?? "");
    this.status = el("p", { class: "status", "aria-live": "off" });
    this.tabs = ["From above", "3D"].map((name, i) =>
      el("button", { type: "button", "aria-pressed": i === 0, onclick: () => this.turn(i === 1) }, name),
    );
    const zoom = (name, text, act) => el("button", { type: "button", "aria-label": name, title: name, onclick: act }, text);
    root.append(
      el("div", { class: "stage" }, this.flat, this.space, this.status, this.pointer, credit,
        el("div", { class: "tabs", role: "group", "aria-label": "view" }, this.tabs),
        el("div", { class: "zoom", role: "group", "aria-label": "zoom" },
          zoom("zoom in", "+", () => this.zoom(1.4)),
          zoom("zoom out", "−", () => this.zoom(1 / 1.4)),
          zoom("show all", "⤢", () => this.fit()))),
      under ?? "",
      el("div", { class: "layers", role: "group", "aria-label": "what is shown" }, this.toggles()),
      this.roster(),
    );
    for (const view of [this.flat, this.space]) {
      for (const kind of ["pointermove", "pointerdown"]) view.addEventListener(kind, (event) => this.point(event));
      view.addEventListener("pointerleave", () => (this.pointer.hidden = true));
    }
    this.map = new FlightMap(this.flat, replay, this.layers, (k) => this.select(k));
    clock.listen((time) => this.show(time));
  }

  toggles() {
    return this.legend.map(({ name, text }) => {
      const box = this.boxes[name] = el("input", { type: "checkbox", name, onchange: () => this.layer(name, box.checked) });
      box.checked = this.layers[name];
      return el("label", {}, box, ` ${text}`);
    });
  }

  layer(name, shown) {
    this.layers[name] = shown;
    this.clock.changed();
  }

  // A button for each vehicle: whose reach, links and scan are looked at.
  roster() {
    this.chips = this.replay.vehicles.map(({ id }, k) => {
      const dot = el("i", { "aria-hidden": "true" });
      return el(
        "button",
        { type: "button", "aria-pressed": false, "aria-label": `vehicle ${id}`, onclick: () => this.select(this.selected === k ? null : k) },
        dot,
        String(id),
      );
    });
    this.paint();
    return el("div", { class: "roster", role: "group", "aria-label": "vehicles" }, this.chips);
  }

  paint() {
    this.chips.forEach((chip, k) => chip.firstChild.style.setProperty("background", vehicleColour(k)));
  }

  select(k) {
    this.selected = k;
    this.map.selected = k;
    this.chips.forEach((chip, index) => chip.setAttribute("aria-pressed", index === k));
    this.clock.changed();
  }

  // Choose a vehicle and stay with it, or let it go.
  follow(k) {
    const stays = !(this.layers.follow && this.selected === k);
    this.boxes.follow.checked = this.layers.follow = stays;
    this.select(stays ? k : null);
  }

  // Where on the ground a pointer is.
  point({ offsetX: px, offsetY: py }) {
    const at = this.space.hidden ? this.map.view?.enu(px, py) : this.scene?.enu(px, py);
    this.pointer.hidden = !at;
    if (at) this.pointer.value = positionText(at, this.map.plane);
  }

  zoom(factor) {
    if (this.space.hidden) this.map.zoom(factor);
    else this.scene?.zoom(factor);
  }

  fit() {
    if (this.space.hidden) this.map.fit();
    else this.scene?.fit();
  }

  async turn(toSpace) {
    this.tabs.forEach((tab, i) => tab.setAttribute("aria-pressed", (i === 1) === toSpace));
    this.space.hidden = !toSpace;
    this.flat.hidden = toSpace;
    if (toSpace && !this.scene) {
      const { Scene3D } = await import("./scene.js");
      try {
        this.scene = new Scene3D(this.space, this.replay, this.layers, () => this.clock.changed());
      } catch (error) {
        this.space.replaceChildren(el("p", {}, `This browser shows no 3D (WebGL): ${error.message}`));
      }
    }
    this.clock.changed();
  }

  show(time) {
    const { replay } = this;
    if (this.space.hidden) this.map.show(time);
    else this.scene?.show(time, this.selected);
    if (!replay.time.length) return;
    const { row } = replay.at(time);
    const leader = replay.swarm.leader[row];
    const phase = PHASES[replay.swarm.phase[row]] ?? "on the ground";
    const words = [phase, leader ? `vehicle ${leader} leads` : "no leader", `${replay.swarm.links[row]} ${replay.swarm.links[row] === 1 ? "link" : "links"}`];
    this.status.textContent = [...words, ...this.told(row)].join(" · ");
  }

  // Of the selected vehicle.
  told(row) {
    if (this.selected === null) return [];
    const one = this.replay.vehicles[this.selected];
    const found = [`${one.id}: ${one.up_m[row].toFixed(1)} m up`, `radio ${one.range_m[row].toFixed(0)} m`];
    if (!one.alive[row]) found.push("companion silent");
    const off = one.estimate_off;
    if (off && !Number.isNaN(off.east_m[row])) {
      found.push(`estimate ${Math.hypot(off.east_m[row], off.north_m[row]).toFixed(2)} m off`);
    }
    return found;
  }

  themed() {
    this.paint();
    this.scene?.themed();
  }
}
