// The page: a flight, two flights beside each other, a flight under way, or a study.
import { Clock } from "./clock.js";
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

function flights(page, replays, themed, clock) {
  const longest = replays.reduce((a, b) => (b.end > a.end ? b : a));
  const views = el("div", { class: replays.length > 1 ? "flights two" : "flights" });
  const side = el("aside");
  const plots = el("section", { class: "plots", "aria-label": "figures over time" });
  const bar = el("div");
  page.append(
    replays.length > 1 ? el("h1", {}, replays.map(({ title }) => title).join(" beside ")) : header(replays[0]),
    el("div", { class: "main" }, el("div", { class: "left" }, views, replays.length > 1 ? bar : null), side),
    ...(replays.length > 1 ? [] : [plots]),
    ...details(replays),
    el("footer", {}, `${replays[0].madeBy}. Space plays, arrows step, [ and ] go from event to event.`),
  );
  const shown = replays.map((replay) => {
    const root = el("section", { class: "flight" });
    views.append(root);
    if (replays.length > 1) root.append(header(replay, "h2"));
    return new FlightView(root, replay, clock, replays.length > 1 ? null : bar);
  });
  const parts = [new TimeBar(bar, longest, clock)];
  replays.forEach((replay, i) => {
    const list = el("section", { class: "happened" });
    side.append(list);
    if (replays.length > 1) list.append(el("h2", {}, replay.title));
    parts.push(new EventList(list, replay, clock, (k) => shown[i].select(k)));
    if (replays.length > 1) {
      const own = el("section", { class: "plots" });
      views.children[i].append(own);
      parts.push(new Plots(own, replay, clock));
    } else parts.push(new Plots(plots, replay, clock));
  });
  for (const part of parts) clock.listen((time) => part.show(time));
  themed.push(() => {
    for (const one of [...shown, ...parts]) (one.themed ?? one.redraw)?.call(one);
    clock.changed();
  });
  keys(clock, longest);
  return { shown, parts, bar };
}

function recorded(page, replays, themed) {
  const longest = replays.reduce((a, b) => (b.end > a.end ? b : a));
  const clock = new Clock(Math.min(...replays.map((replay) => replay.start)), longest.end);
  flights(page, replays, themed, clock);
  clock.seek(firstMoment(longest));
  addEventListener("hashchange", () => clock.seek(firstMoment(longest)));
}

function live(page, doc, stream, themed) {
  const replay = new LiveReplay(doc.replay);
  replay.verdict.text = "under way";
  const clock = new LiveClock(replay);
  const { shown, parts, bar } = flights(page, [replay], themed, clock);
  const controls = new Controls(bar, doc.controls, (wish) => stream.ask(wish), () => shown[0].selected);
  clock.listen(() => controls.show());
  const ended = (verdict, limits) => {
    Object.assign(replay, { verdict, limits });
    page.querySelector("header").replaceWith(header(replay));
    controls.finish();
  };
  if (doc.pace) controls.told(doc.pace);
  follow(stream, replay, clock, parts, {
    told: ({ pace }) => pace && controls.told(pace),
    over: ({ verdict, limits, report }) => {
      ended(verdict, limits);
      if (report) bar.append(el("p", { class: "note" }, `The replay of it: ${report}`));
    },
    lost: () => ended({ text: "The flight's program is gone; this is what it told", succeeded: null }, []),
  });
  clock.changed();
}

async function start() {
  const page = document.getElementById("page");
  const { doc, stream } = await source();
  const themed = [];
  const switchTheme = setUp(() => themed.forEach((told) => told()));
  page.replaceChildren(el("button", { class: "theme", type: "button", "aria-label": "light or dark", title: "light or dark", onclick: switchTheme }, "◐"));
  if (doc.format === "understory-study") study(page, doc);
  else if (doc.format === "understory-live") live(page, doc, stream, themed);
  else recorded(page, (doc.flights ?? [doc]).map((one) => new Replay(one)), themed);
  requestAnimationFrame(() => requestAnimationFrame(() => {
    document.documentElement.dataset.ready = String(Math.round(performance.now()));
  }));
}

start().catch((error) => {
  document.getElementById("page").append(el("p", { class: "verdict bad" }, `This page cannot be shown: ${error.message}`));
  throw error;
});
