// d1, stops and d2 as rows of numbers: what the map does, by keyboard.
import { el } from "../src/dom.js";
import { explain, fill } from "./form.js";
import { readValue, shownValue } from "./words.js";

const AXES = ["east", "north", "up"];

export class Places {
  // `acts`: { typed(name, enu), removed(name), chosen(name), wrong(text) }
  constructor(acts) {
    this.acts = acts;
    this.body = el("tbody");
    const head = el("tr", {}, ["", ...AXES.map((axis) => `${axis}, m`), ""].map((text) => el(text ? "th" : "td", text ? { scope: "col" } : {}, text)));
    this.node = el("table", { class: "places" }, el("thead", {}, head), this.body);
    this.rows = new Map(); // by name
  }

  show(points, reasons) {
    const names = points.map(({ name }) => name);
    if (names.join() !== [...this.rows.keys()].join()) this.build(points);
    for (const { name, enu } of points) {
      const shown = this.rows.get(name);
      const { inputs, row, why } = shown;
      if (enu || shown.known) inputs.forEach((input, k) => fill(input, enu ? shownValue(enu[k]) : "")); // else it is being typed
      shown.known = enu !== null;
      explain(inputs[0], why, reasons.get(name) ?? []);
      why.closest("tr").hidden = why.hidden;
      row.classList.toggle("bad", !why.hidden);
    }
  }

  // That point's row is marked. No numbers are shown anew: what has just been typed may not be answered yet.
  choose(point) {
    for (const [name, { row }] of this.rows) row.classList.toggle("chosen", name === point);
  }

  build(points) {
    this.rows.clear();
    this.body.replaceChildren(...points.flatMap((point) => this.row(point)));
  }

  row({ name, about }) {
    const why = el("p", { class: "why", id: `why-${name.replace(" ", "-")}`, hidden: true });
    const inputs = AXES.map((axis) => el("input", { type: "number", step: 0.1, inputmode: "decimal", "aria-label": `${name}, ${axis}, m`, "aria-describedby": why.id, onchange: () => this.read(name) }));
    const gone = name.startsWith("stop") && el("button", { type: "button", "aria-label": `Remove ${name}`, onclick: () => this.acts.removed(name) }, "✕");
    const row = el("tr", { onfocusin: () => this.acts.chosen(name) }, el("th", { scope: "row" }, name, el("small", {}, about)), ...inputs.map((input) => el("td", {}, input)), el("td", {}, gone || null));
    this.rows.set(name, { inputs, row, why, known: false });
    return [row, el("tr", { class: "whyrow", hidden: true }, el("td", { colspan: 5 }, why))];
  }

  // Once all three are there.
  read(name) {
    const read = this.rows.get(name).inputs.map((input) => readValue("number", input.value));
    if (read.some(({ wrong }) => wrong)) this.acts.wrong(`${name}: must be numbers`);
    else if (read.every(({ value }) => value !== undefined)) this.acts.typed(name, read.map(({ value }) => value));
  }
}
