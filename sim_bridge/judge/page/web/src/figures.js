// Verdict, limits, figures, mission: what a reader looks up.
import { el } from "./dom.js";

export function shown(value) {
  if (value === null || value === undefined) return "–";
  if (typeof value === "boolean") return value ? "yes" : "no";
  if (Array.isArray(value)) return value.length ? value.map(shown).join(", ") : "none";
  if (typeof value !== "number" || Number.isInteger(value)) return String(value);
  return Math.abs(value) >= 1000 ? value.toFixed(0) : String(Number(value.toPrecision(4)));
}

export function header(replay) {
  const { text, succeeded } = replay.verdict;
  const state = succeeded === null ? "unknown" : succeeded ? "good" : "bad";
  const words = text ?? "No verdict: why the flight ended is not known";
  return el(
    "header",
    {},
    el("h1", {}, replay.title),
    el("p", { class: `verdict ${state}` }, words),
    replay.standReport ? el("p", {}, el("a", { href: replay.standReport }, "For foresters: stand report, with the map of stems")) : "",
    el("ul", { class: "limits" }, replay.limits.map((limit) =>
      el("li", { class: limit.kept === false ? "broken" : limit.kept ? "kept" : "" },
        el("span", {}, limit.name), el("b", {}, limit.flown),
        limit.allowed ? el("small", {}, `${limit.kept === false ? "✗ " : limit.kept ? "✓ " : ""}${limit.allowed}`) : null))),
  );
}

function table(rows) {
  return el("div", { class: "wide", tabindex: "0" }, el("table", {},
    el("tbody", {}, rows.map(([name, value]) => el("tr", {}, el("th", { scope: "row" }, name), el("td", {}, value))))));
}

export function details(replay) {
  const rows = replay.figures.map(([name, value]) => [name, shown(value)]);
  return [
    el("details", {}, el("summary", {}, "Figures"), table(rows)),
    el("details", {}, el("summary", {}, "Mission as flown"),
      el("p", {}, `${replay.madeBy}, seed ${replay.seed}, ${replay.vehicles.length} vehicles`),
      replay.needs ? el("p", {}, `It needs ${replay.needs}`) : "",
      el("pre", { tabindex: "0" }, replay.missionToml)),
  ];
}
