// What happened, in the order of time: each entry goes there.
import { el, seconds } from "./dom.js";

const NAMES = { fault: "fault", lead: "leader", phase: "phase", lost: "lost", contact: "contact", closest: "closest", parted: "links", text: "message", end: "end" };
const PASSING = ["notice", "info", "debug"];

export class EventList {
  constructor(root, replay, clock, picked) {
    this.events = replay.events;
    this.clock = clock;
    this.picked = picked;
    this.buttons = [];
    this.list = el("ol", { class: "events", tabindex: "0", "aria-label": "events" });
    this.quiet = true;
    const texts = el("input", { type: "checkbox", onchange: () => this.hush(!texts.checked, clock) });
    this.choice = el("label", { hidden: true }, texts, " all messages");
    this.grew();
    root.append(el("div", { class: "head" }, el("h3", {}, "Events"), this.choice), this.list);
    this.list.classList.add("quiet");
    this.last = -1;
  }

  // There may be more of them.
  grew() {
    for (const event of this.events.slice(this.buttons.length)) {
      const button = this.button(event);
      this.buttons.push(button);
      this.list.append(el("li", {}, button));
      if (PASSING.includes(event.severity)) this.choice.hidden = false; // a flight under way tells no severities
    }
  }

  button(event) {
    const go = () => {
      this.clock.playing = false;
      this.clock.seek(event.time_s);
      if (event.vehicles.length === 1) this.picked(event.vehicles[0] - 1);
    };
    return el(
      "button",
      { type: "button", class: `event ${event.kind} ${event.severity ?? ""}`, onclick: go },
      el("time", {}, seconds(event.time_s)),
      el("b", {}, NAMES[event.kind] ?? event.kind),
      el("span", {}, event.text),
    );
  }

  // Whether what vehicles say in passing is left out.
  hush(quiet, clock) {
    this.quiet = quiet;
    this.list.classList.toggle("quiet", quiet);
    clock.changed();
  }

  show(time) {
    let last = -1;
    for (let i = 0; i < this.events.length && this.events[i].time_s <= time + 1e-6; i++) {
      if (!(this.quiet && PASSING.includes(this.events[i].severity))) last = i;
    }
    if (last === this.last) return;
    this.buttons[this.last]?.removeAttribute("aria-current");
    this.last = last;
    const button = this.buttons[last];
    if (!button) return;
    button.setAttribute("aria-current", "true");
    const { list } = this;
    const top = button.offsetTop - list.offsetTop;
    if (top < list.scrollTop || top + button.offsetHeight > list.scrollTop + list.clientHeight) {
      list.scrollTop = top - list.clientHeight / 2;
    }
  }
}
