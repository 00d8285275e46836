// The page around a flight: its settings, the worker that flies, and the view, which is the live map's page in a frame.
const byId = (id) => document.getElementById(id);
const form = document.querySelector("form");
const frame = document.querySelector("iframe");
const button = form.querySelector("button");
const sliders = [...form.querySelectorAll("input")];
const worker = new Worker("worker.js", { type: "module" });
const PLACES = 2; // of a speed
const STAGE = ".stage { height: clamp(320px, 62vw, 620px); }"; // by width: the frame is as high as what is in it
let flying = null; // the settings of the flight that is shown
let began = 0;

function say(text, bad = false) {
  const status = byId("status");
  status.textContent = text;
  status.classList.toggle("bad", bad);
}

function shown(slider) {
  if ("percent" in slider.dataset) return `${Math.round(100 * slider.value)} %`;
  if (slider.name === "density_per_ha" && slider.value === "0") return "one";
  return `${slider.value}${slider.dataset.unit ?? ""}`;
}

function label(slider) {
  slider.parentElement.querySelector("output").textContent = shown(slider);
}

function wanted() {
  return Object.fromEntries(sliders.map(({ name, value }) => [name, Number(value)]));
}

// The mission's own bounds; what the address asks for comes first: ?size=4&seed=2
function setUp(settings) {
  const asked = new URLSearchParams(location.search);
  for (const slider of sliders) {
    const { least, most, step, usual } = settings[slider.name];
    Object.assign(slider, { min: least, max: most, step });
    slider.value = asked.get(slider.name) ?? usual;
    slider.addEventListener("input", () => label(slider));
    label(slider);
  }
}

// The worker begins a flight when its view asks for one.
function fly() {
  flying = wanted();
  const query = new URLSearchParams(flying);
  history.replaceState(null, "", `?${query}`);
  say("Making the stand …");
  document.documentElement.dataset.flight = "begins";
  byId("trace").hidden = true;
  frame.hidden = false;
  frame.src = `view.html?${query}`;
}

function command({ kills, ticks }) {
  const words = kills.map(([tick, vehicle]) => ` --kill ${tick}:${vehicle}`);
  return `python -m docs.website.native --musl --until ${ticks} --settings '${JSON.stringify(flying)}'${words.join("")}`;
}

function follow(figures) {
  byId("trace").hidden = false;
  byId("ticks").textContent = figures.ticks;
  byId("hash").textContent = figures.trace;
  byId("command").textContent = command(figures);
  const speed = figures.speed === null ? "" : `, up to ${figures.speed.toFixed(PLACES)}× real time in this browser`;
  say(`${figures.time_s.toFixed(1)} s flown${speed}${figures.ended ? `. Over: ${figures.ended}` : ""}`);
  document.documentElement.dataset.flight = figures.ended ? "over" : "flies";
}

const TOLD = {
  loading: ({ text }) => say(text),
  ready: ({ settings }) => {
    document.documentElement.dataset.loaded = String(Math.round(performance.now()));
    setUp(settings);
    button.disabled = false;
    fly();
  },
  begun: () => {
    began = performance.now();
    document.documentElement.dataset.begun = String(Math.round(began));
  },
  figures: ({ figures }) => follow(figures),
  wrong: ({ text }) => {
    say(text, true);
    frame.hidden = true;
    document.documentElement.dataset.flight = "refused";
  },
};

worker.onmessage = ({ data }) => TOLD[data.tell](data);
worker.onerror = ({ message }) => say(`The flight cannot be loaded: ${message}`, true);

addEventListener("message", ({ origin, source, data, ports }) => {
  if (origin !== location.origin || source !== frame.contentWindow || data !== "understory-view") return;
  worker.postMessage({ settings: JSON.stringify(flying), port: ports[0] }, [ports[0]]);
});

// As high as what is in it: one page that scrolls, not two.
frame.addEventListener("load", () => {
  const { body, head } = frame.contentDocument;
  const style = head.ownerDocument.createElement("style");
  style.textContent = STAGE;
  head.append(style);
  new ResizeObserver(() => {
    frame.style.height = `${body.scrollHeight + 2}px`;
  }).observe(body);
});

form.addEventListener("submit", (event) => {
  event.preventDefault();
  fly();
});
