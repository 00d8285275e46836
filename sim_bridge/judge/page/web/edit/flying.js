// A flight of the mission as it is on the page, in the simulator: what it says, and its replay.
import { el } from "../src/dom.js";

const LOOK_MS = 400;

export class Flying {
  // `look()`: a promise of the flight, as the server tells it; `stop()`: ends it.
  constructor(look, stop) {
    Object.assign(this, { look, flight: null, timer: null });
    this.title = el("h2", {}, "Flight");
    this.said = el("p", { class: "said", role: "status" });
    this.stopper = el("button", { type: "button", onclick: stop }, "Stop");
    this.live = el("a", { target: "_blank", rel: "noopener", hidden: true }, "Watch it live");
    this.whole = el("a", { target: "_blank", rel: "noopener", href: "/flight/report.html", hidden: true }, "Open the replay by itself");
    this.lines = el("pre", { tabindex: 0, "aria-label": "What the simulator says" });
    this.frame = el("div", { class: "replay" });
    this.node = el("section", { class: "flight", hidden: true, "aria-label": "Flight" }, this.title, el("div", { class: "bar" }, this.said, this.stopper, this.live, this.whole), this.frame, el("details", { open: true }, el("summary", {}, "What the simulator says"), this.lines));
  }

  show(flight, revision) {
    this.flight = flight;
    if (!flight?.number) return;
    this.node.hidden = false;
    this.said.textContent = textOf(flight, revision);
    this.stopper.hidden = !flight.is_under_way;
    this.live.hidden = !flight.map;
    if (flight.map) this.live.href = flight.map;
    this.whole.hidden = !flight.has_report;
    this.lines.textContent = flight.lines.join("\n");
    this.lines.scrollTop = this.lines.scrollHeight;
    this.showReplay(flight);
    clearTimeout(this.timer);
    if (flight.is_under_way) this.timer = setTimeout(() => this.look(), LOOK_MS);
  }

  // A frame of its own for each flight. It has no origin: what is in it reaches nothing here.
  showReplay({ number, has_report: has }) {
    const wanted = has ? String(number) : "";
    if (this.frame.dataset.number === wanted) return;
    this.frame.dataset.number = wanted;
    this.frame.replaceChildren(...(has ? [el("iframe", { title: "Replay of the flight", sandbox: "allow-scripts", src: `/flight/report.html?${number}` })] : []));
  }
}

export function textOf(flight, revision) {
  const last = flight.lines.at(-1) ?? "";
  const older = flight.revision === revision ? "" : " (of the mission before your last changes)";
  if (flight.is_under_way) return `Flying in point masses${older}: ${last.trim()}`;
  if (flight.code === null) return last;
  return `${last.trim() || `sim-bridge ended with code ${flight.code}`}${older}`;
}
