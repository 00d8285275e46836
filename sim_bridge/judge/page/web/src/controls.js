// What a viewer can do to a simulated flight: its pace, and what goes wrong.
import { el } from "./dom.js";

const SPEEDS = [0.25, 0.5, 1, 2, 5, 10, 20];
const RADIO_LOST_S = 20;
const WINDS = { "as the mission says": null, calm: [0, 0], "3 m/s from the west": [3, 0], "6 m/s from the west": [6, 0], "6 m/s from the north": [0, -6] };

export class Controls {
  // `can`: the names of what may be asked for; `whom()`: the index of the selected vehicle, or null: the leader.
  constructor(root, can, ask, whom) {
    this.whom = whom;
    this.paused = false;
    const button = (name, text, act) => (can.includes(name) ? el("button", { type: "button", class: name, onclick: act }, text) : null);
    const target = () => (whom() === null ? {} : { vehicle: whom() + 1 });
    this.pause = button("pause", "Pause flight", () => ask({ do: this.paused ? "resume" : "pause" }));
    this.kill = button("kill", "Kill leader", () => ask({ do: "kill", ...target() }));
    this.radio = button("radio", "", () => ask({ do: "radio", for_s: RADIO_LOST_S, ...target() }));
    this.speed = can.includes("speed") ? this.select("speed of the flight", [...SPEEDS.map((value) => [String(value), `${value}× real time`]), ["max", "as fast as it goes"]], (value) =>
      ask({ do: "speed", factor: value === "max" ? null : Number(value) })) : null;
    this.wind = can.includes("wind") ? this.select("wind", Object.keys(WINDS).map((name) => [name, `wind: ${name}`]), (name) =>
      WINDS[name] && ask({ do: "wind", wind_mps: WINDS[name] })) : null;
    const step = button("step", "Step", () => ask({ do: "step" }));
    root.append(el("div", { class: "controls", role: "group", "aria-label": "the simulated flight" },
      this.pause, step, this.speed, this.kill, this.radio, this.wind));
    this.show();
  }

  select(name, options, chosen) {
    const made = el("select", { "aria-label": name, onchange: () => chosen(made.value) });
    for (const [value, text] of options) made.append(el("option", { value }, text));
    return made;
  }

  // As the flight says that it goes.
  setPace({ paused, factor }) {
    this.paused = paused;
    if (this.pause) this.pause.textContent = paused ? "Resume flight" : "Pause flight";
    if (this.speed) this.speed.value = factor === null ? "max" : String(factor);
  }

  show() {
    const k = this.whom();
    const which = k === null ? "leader" : `vehicle ${k + 1}`;
    if (this.kill) this.kill.textContent = `Kill ${which}`;
    if (this.radio) this.radio.textContent = `No radio for ${which}, ${RADIO_LOST_S} s`;
  }

  finish() {
    for (const control of [this.pause, this.kill, this.radio, this.speed, this.wind]) if (control) control.disabled = true;
    document.querySelector(".controls .step")?.setAttribute("disabled", "");
  }
}
