// The page: a flight, a flight under way, or a study.
import { Clock } from "./clock.js";
import { comparisonFigures, comparisonHeader, paired } from "./compare.js";
import { Controls } from "./controls.js";
import { el } from "./dom.js";
import { EventList } from "./events.js";
import { details, header } from "./figures.js";
import { FlightView } from "./flight.js";
import { LiveClock, LiveReplay, follow } from "./live.js";
import { Plots } from "./plots.js";
import { Replay } from "./replay.js";
import { source } from "./source.js";
import { study } from "./study.js";
import { setUp } from "./theme.js";
import { VehicleTable } from "./table.js";
import { TimeBar } from "./timebar.js";

// Half-way, where there is something to see, or where the address says: report.html#t=40
function firstMoment(replay) {
  const asked = /^#t=([\d.]+)$/.exec(location.hash);
  if (asked) return Number(asked[1]);
  const { phase } = replay.swarm;
  const first = phase.indexOf(2);
  return first < 0 ? replay.end : replay.time[Math.floor((first + phase.lastIndexOf(2)) / 2)];
}

function keys(clock, replay) {
  const onward = (sign) => {
    const times = replay.events.map((event) => event.time_s);
    const next = sign > 0 ? times.find((time) => time > clock.time + 0.05) : times.findLast((time) => time < clock.time - 0.05);
    if (next !== undefined) clock.seek(next);
  };
  const acts = {
    " ": () => clock.toggle(),
    ArrowLeft: (event) => clock.step(event.shiftKey ? -1 : -0.1),
    ArrowRight: (event) => clock.step(event.shiftKey ? 1 : 0.1),
    Home: () => clock.seek(clock.start),
    End: () => clock.seek(clock.end),
    "[": () => onward(-1),
    "]": () => onward(1),
  };
  addEventListener("keydown", (event) => {
    if (event.target.closest("button, input, select, canvas, summary, .space, ol, pre, .wide")) return;
    if (event.ctrlKey || event.metaKey || event.altKey || !acts[event.key]) return;
    event.preventDefault();
    acts[event.key](event);
  });
}

// What a page of a flight consists of; `parts` grow with a flight under way.
function flight(page, replay, themed, clock, comparison = null) {
  const root = el("section", { class: "flight" });
  const list = el("section", { class: "happened" });
  const plots = el("section", { class: "plots", "aria-label": "figures over time" });
  const table = el("section", { class: "by-vehicle" });
  const bar = el("div");
  page.append(
    comparison ? comparisonHeader(replay, comparison, replay.against.notes) : header(replay),
    el("div", { class: "main" }, el("div", { class: "left" }, root), el("aside", {}, list)),
    comparison ? comparisonFigures(comparison) : "",
    table,
    plots,
    ...details(replay),
    el("footer", {}, `${replay.madeBy}. Space plays, arrows step, [ and ] go from event to event.`),
  );
  const view = new FlightView(root, replay, clock, bar);
  const parts = [new TimeBar(bar, replay, clock), new EventList(list, replay, clock, (k) => view.select(k)), new Plots(plots, replay, clock)];
  if (replay.byVehicle.length) parts.push(new VehicleTable(table, replay, view));
  if (replay.against) parts.push(new VehicleTable(table, replay.against, null));
  for (const part of parts) clock.listen((time) => part.show(time));
  themed.push(() => {
    for (const one of [view, ...parts]) (one.themed ?? one.redraw)?.call(one);
    clock.changed();
  });
  keys(clock, replay);
  return { view, parts, bar };
}

function recorded(page, doc, themed) {
  const replay = doc.against ? paired(doc) : new Replay(doc);
  const clock = new Clock(replay.start, Math.max(replay.end, replay.against?.end ?? 0));
  flight(page, replay, themed, clock, doc.comparison);
  clock.seek(firstMoment(replay));
  addEventListener("hashchange", () => clock.seek(firstMoment(replay)));
}

function live(page, doc, stream, themed) {
  const replay = new LiveReplay(doc.replay);
  replay.verdict.text = "under way";
  const clock = new LiveClock(replay);
  const { view, parts, bar } = flight(page, replay, themed, clock);
  const controls = new Controls(bar, doc.controls, (request) => stream.ask(request), () => view.selected);
  clock.listen(() => controls.show());
  const ended = (verdict, limits) => {
    Object.assign(replay, { verdict, limits });
    page.querySelector("header").replaceWith(header(replay));
    controls.finish();
  };
  if (doc.pace) controls.setPace(doc.pace);
  follow(stream, replay, clock, parts, {
    received: ({ pace }) => pace && controls.setPace(pace),
    over: ({ verdict, limits, report }) => {
      ended(verdict, limits);
      if (report) bar.append(el("p", { class: "note" }, el("a", { href: "./" }, "The whole replay"), `, with figures and a table of vehicles, is also in ${report}`));
    },
    lost: () => ended({ text: "Link to the simulation lost; this is what was received", succeeded: null }, []),
  });
  clock.changed();
}

async function start() {
  const page = document.getElementById("page");
  const { doc, stream } = await source();
  const themed = [];
  const switchTheme = setUp(() => themed.forEach((redraw) => redraw()));
  page.replaceChildren(el("button", { class: "theme", type: "button", "aria-label": "light or dark", title: "light or dark", onclick: switchTheme }, "◐"));
  if (doc.format === "understory-study") study(page, doc);
  else if (doc.format === "understory-live") live(page, doc, stream, themed);
  else recorded(page, doc, themed);
  requestAnimationFrame(() => requestAnimationFrame(() => {
    document.documentElement.dataset.ready = String(Math.round(performance.now()));
  }));
}

start().catch((error) => {
  document.getElementById("page").append(el("p", { class: "verdict bad" }, `This page cannot be shown: ${error.message}`));
  throw error;
});
