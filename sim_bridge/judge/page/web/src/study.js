// A study: its answer, what it had to reach, how its figures spread over the seeds, and the flights to look at.
import { el } from "./dom.js";
import { shown } from "./figures.js";

const SVG = "http://www.w3.org/2000/svg";
const ROW_PX = 26;
const NAME_PX = 210;
const NAME_CHARS = 32; // of a line of a case's name
const LINE_PX = 13;
const WIDE_PX = 760;

function svg(tag, attributes, ...children) {
  const made = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  made.append(...children);
  return made;
}

// Round numbers between two ends, about `count` of them.
function ticks(low, high, count) {
  const wanted = (high - low) / count || 1;
  const power = 10 ** Math.floor(Math.log10(wanted));
  const step = power * [1, 2, 5, 10].find((factor) => factor * power >= wanted);
  const found = [];
  for (let value = Math.ceil(low / step) * step; value <= high + step * 1e-6; value += step) found.push(Number(value.toPrecision(12)));
  return found;
}

// A case's name in lines of at most NAME_CHARS, broken between its settings; a longer word is broken where it must be.
export function wrapped(name) {
  const lines = [""];
  for (const word of name.split(" ").flatMap((one) => one.match(new RegExp(`.{1,${NAME_CHARS}}`, "g")) ?? [])) {
    const last = lines.at(-1);
    if (!last) lines[lines.length - 1] = word;
    else if (last.length + 1 + word.length <= NAME_CHARS) lines[lines.length - 1] = `${last} ${word}`;
    else lines.push(word);
  }
  return lines;
}

// A dot for each seed, a line for each case; its mean, with the 95 % interval.
function distribution({ name, cases }) {
  const values = cases.flatMap(({ seeds, low, high }) => [...seeds.map(([, value]) => value), low, high]).filter((v) => v !== null);
  const [low, high] = [Math.min(...values), Math.max(...values)];
  if (low === high) return el("section", { class: "distribution" }, el("h3", {}, name), el("p", { class: "note" }, `${shown(low)} in every flight`));
  const x = (value) => NAME_PX + 12 + ((value - low) / (high - low)) * (WIDE_PX - NAME_PX - 40);
  const names = cases.map((one) => wrapped(one.name));
  const heights = names.map((lines) => Math.max(ROW_PX, LINE_PX * (lines.length + 1)));
  const height = heights.reduce((sum, one) => sum + one, 26);
  const drawn = svg("svg", { viewBox: `0 0 ${WIDE_PX} ${height}`, role: "group", "aria-label": `${name}, by case and seed` });
  for (const tick of ticks(low, high, 7)) {
    drawn.append(
      svg("line", { x1: x(tick), x2: x(tick), y1: 0, y2: height - 22, class: "gridline" }),
      svg("text", { x: x(tick), y: height - 6, "text-anchor": "middle" }, shown(tick)),
    );
  }
  let top = 0;
  cases.forEach((one, index) => {
    drawn.append(line(one, names[index], top + heights[index] / 2, x));
    top += heights[index];
  });
  return el("section", { class: "distribution" }, el("h3", {}, name), el("div", { class: "wide", tabindex: "0" }, drawn));
}

function line(one, name, y, x) {
  const first = y + 4 - (LINE_PX * (name.length - 1)) / 2;
  const group = svg("g", {}, ...name.map((text, row) => svg("text", { x: NAME_PX, y: first + LINE_PX * row, "text-anchor": "end" }, text)));
  for (const [seed, value, replay] of one.seeds) {
    const dot = svg("circle", { cx: x(value), cy: y + ((seed * 7) % 9) - 4, r: replay ? 5 : 3, class: replay ? "dot linked" : "dot" }, svg("title", {}, `seed ${seed}: ${shown(value)}`));
    group.append(replay ? svg("a", { href: replay, "aria-label": `replay of seed ${seed}` }, dot) : dot);
  }
  if (one.low !== null) group.append(svg("line", { x1: x(one.low), x2: x(one.high), y1: y, y2: y, class: "interval" }));
  group.append(svg("line", { x1: x(one.mean), x2: x(one.mean), y1: y - 8, y2: y + 8, class: "mean" }, svg("title", {}, `mean ${shown(one.mean)}`)));
  return group;
}

function table(heads, rows) {
  return el("div", { class: "wide", tabindex: "0" }, el("table", {},
    el("thead", {}, el("tr", {}, heads.map((head) => el("th", { scope: "col" }, head)))),
    el("tbody", {}, rows.map((cells) => el("tr", {}, cells.map((cell) => el("td", {}, cell)))))));
}

export function study(page, doc) {
  const state = doc.succeeded === null ? "unknown" : doc.succeeded ? "good" : "bad";
  page.append(el("header", {}, el("h1", {}, doc.title), el("p", { class: `verdict ${state}` }, doc.answer)));
  if (doc.must.length) {
    page.append(el("h2", {}, "What it had to reach"), table(
      ["run", "case", "figure", "must", "seen", ""],
      doc.must.map((v) => [v.run, v.case, `${v.figure}, ${v.statistic}`, shown(v.must), shown(v.seen), v.reached ? "✓ reached" : "✗ missed"]),
    ));
  }
  if (doc.worst.length) {
    const rows = doc.worst.map((one) => [
      one.case,
      String(one.seed),
      one.why,
      one.verdict,
      one.replay ? el("a", { href: one.replay }, "replay") : "–",
    ]);
    page.append(el("h2", {}, "Flights to look at"), table(["case", "seed", "why", "verdict", "replay"], rows));
    if (doc.worst.every(({ replay }) => !replay)) {
      page.append(el("p", { class: "note" }, "None was flown again: sim-bridge study FILE --replay 3 does that. Point masses have no replay."));
    }
  }
  page.append(el("h2", {}, "Over the seeds"), el("p", { class: "note" }, "A dot for each flight; the bar is the mean, the line its 95 % interval. Large dots lead to a replay."));
  page.append(el("div", { class: "distributions" }, doc.figures.map(distribution)), el("footer", {}, doc.made_by));
}
