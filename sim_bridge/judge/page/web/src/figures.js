// Verdict, limits, figures, mission: what a reader looks up.
import { el } from "./dom.js";

export function shown(value) {
  if (value === null || value === undefined) return "–";
  if (Array.isArray(value)) return value.length ? value.join(", ") : "none";
  if (typeof value !== "number" || Number.isInteger(value)) return String(value);
  return Math.abs(value) >= 1000 ? value.toFixed(0) : String(Number(value.toPrecision(4)));
}

export function header(replay, heading = "h1") {
  const { text, succeeded } = replay.verdict;
  const state = succeeded === null ? "unknown" : succeeded ? "good" : "bad";
  const words = text ?? "No verdict: why the flight ended is not known";
  return el(
    "header",
    {},
    el(heading, {}, replay.title),
    el("p", { class: `verdict ${state}` }, words),
    el("ul", { class: "limits" }, replay.limits.map((limit) =>
      el("li", { class: limit.kept === false ? "broken" : limit.kept ? "kept" : "" },
        el("span", {}, limit.name), el("b", {}, limit.flown),
        limit.allowed ? el("small", {}, `${limit.kept === false ? "✗ " : limit.kept ? "✓ " : ""}${limit.allowed}`) : null))),
  );
}

function table(rows, heads) {
  return el("div", { class: "wide", tabindex: "0" }, el("table", {},
    heads ? el("thead", {}, el("tr", {}, heads.map((head) => el("th", { scope: "col" }, head)))) : null,
    el("tbody", {}, rows.map(([name, ...cells]) => el("tr", {}, el("th", { scope: "row" }, name), cells.map((cell) => el("td", {}, cell)))))));
}

export function details(replays) {
  const names = [...new Set(replays.flatMap(({ figures }) => Object.keys(figures)))];
  const rows = names.map((name) => {
    const values = replays.map(({ figures }) => figures[name]);
    const cells = values.map(shown);
    if (replays.length === 2) {
      const [a, b] = values;
      cells.push(typeof a === "number" && typeof b === "number" ? shown(b - a) : a === b || cells[0] === cells[1] ? "" : "≠");
    }
    return [name, ...cells];
  });
  const heads = replays.length === 2 ? ["figure", ...replays.map(({ title }) => title), "difference"] : null;
  return [
    el("details", { open: replays.length === 2 }, el("summary", {}, "Figures"), table(rows, heads)),
    ...replays.map((replay) =>
      el("details", {}, el("summary", {}, replays.length === 2 ? `Mission: ${replay.title}` : "Mission as flown"),
        el("p", {}, `${replay.madeBy}, seed ${replay.seed}, ${replay.vehicles.length} vehicles`),
        el("pre", { tabindex: "0" }, replay.missionToml))),
  ];
}
