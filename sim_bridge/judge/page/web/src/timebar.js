// Play, step, speed, and a slider over the phases and events of the flight.
import { SPEEDS } from "./clock.js";
import { el, seconds } from "./dom.js";
import { PHASES } from "./replay.js";

const STEP_S = 0.1;
const MARKED = ["fault", "lead", "contact", "lost", "parted"];

export class TimeBar {
  constructor(root, replay, clock) {
    this.clock = clock;
    this.replay = replay;
    this.marks = this.band(replay);
    this.play = el("button", { class: "play", type: "button", onclick: () => clock.toggle() }, "Play");
    this.slider = el("input", {
      type: "range",
      min: clock.start,
      max: clock.end,
      step: 0.05,
      "aria-label": "time",
      oninput: () => clock.seek(Number(this.slider.value)),
    });
    this.now = el("output", { class: "time" });
    const speed = el("select", { "aria-label": "speed", onchange: () => (clock.speed = Number(speed.value)) });
    for (const value of SPEEDS) speed.append(el("option", { value, selected: value === clock.speed }, `${value}×`));
    const step = (sign, name, text) =>
      el("button", { type: "button", "aria-label": name, title: name, onclick: () => clock.step(sign * STEP_S) }, text);
    root.append(
      el(
        "div",
        { class: "timebar", role: "group", "aria-label": "replay" },
        el("div", { class: "buttons" }, this.play, step(-1, "a step back", "‹"), step(1, "a step on", "›"), speed, this.now),
        el("div", { class: "track" }, this.slider, this.marks),
      ),
    );
  }

  // The phases as a band, with a tick for each event that matters.
  band(replay) {
    const span = Math.max(1e-9, replay.end - replay.start);
    const share = (time) => `${(100 * (time - replay.start)) / span}%`;
    const band = el("div", { class: "band", "aria-hidden": "true" });
    const { phase } = replay.swarm;
    for (let row = 0, from = 0; row < phase.length; row++) {
      if (row + 1 < phase.length && phase[row + 1] === phase[row]) continue;
      const end = replay.time[Math.min(row + 1, phase.length - 1)];
      const name = PHASES[phase[row]] ?? "";
      const part = el("span", { class: `phase ${name}`, title: name }, el("b", {}, name));
      part.style.left = share(replay.time[from]);
      part.style.width = `${(100 * (end - replay.time[from])) / span}%`;
      band.append(part);
      from = row + 1;
    }
    for (const event of replay.events.filter(({ kind }) => MARKED.includes(kind))) {
      const tick = el("i", { class: event.kind, title: `${seconds(event.time_s)} ${event.text}` });
      tick.style.left = share(event.time_s);
      band.append(tick);
    }
    return band;
  }

  // There are more rows, and perhaps events.
  grew() {
    [this.slider.min, this.slider.max] = [this.clock.start, this.clock.end];
    const marks = this.band(this.replay);
    this.marks.replaceWith(marks);
    this.marks = marks;
  }

  show(time) {
    this.slider.value = time;
    this.slider.setAttribute("aria-valuetext", seconds(time));
    this.now.value = `${seconds(time)} of ${seconds(this.clock.end)}`;
    this.play.textContent = this.clock.label;
  }
}
