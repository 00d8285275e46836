// Python in a worker: the page stays alive while the swarm flies.
import { loadPyodide } from "./pyodide/pyodide.mjs";

const SLICE_S = 0.06; // of wall time, between two looks at what viewers ask for
const FIGURES_MS = 500;
let port = null; // to the view
let here = null;
let told = 0;
let timer = 0;

const tell = (message) => postMessage(message);

async function fetched(name) {
  const response = await fetch(new URL(name, import.meta.url));
  if (!response.ok) throw new Error(`${name}: ${response.status}`);
  return response.arrayBuffer();
}

async function load() {
  const names = ["packages.zip", "sources.zip"];
  const [python, ...archives] = await Promise.all([
    loadPyodide({ indexURL: new URL("pyodide/", import.meta.url).href, env: { HOME: "/home", UNDERSTORY_PURE: "1" } }),
    ...names.map(fetched),
  ]);
  tell({ tell: "loading", text: "Loading the flight software …" });
  for (const archive of archives) python.unpackArchive(archive, "zip", { extractDir: "/software" });
  python.runPython("import sys; sys.path.insert(0, '/software')");
  here = python.runPython("from docs.website.world.here import Here; Here()");
  const settings = python.runPython("import dataclasses, json; from docs.website.world.settings import SETTINGS; json.dumps({name: dataclasses.asdict(one) for name, one in SETTINGS.items()})");
  tell({ tell: "ready", settings: JSON.parse(settings) });
}

function begin(settings) {
  const first = here.begin(settings);
  const { wrong } = JSON.parse(first);
  if (wrong) {
    tell({ tell: "wrong", text: wrong });
    return;
  }
  port.postMessage(first);
  tell({ tell: "begun" });
  told = 0;
  turn();
}

function turn() {
  const { wait_s: wait, view, figures } = JSON.parse(here.turn(SLICE_S));
  if (view) port.postMessage(JSON.stringify(view));
  const now = performance.now();
  if (figures && (figures.ended || now - told > FIGURES_MS)) {
    told = now;
    tell({ tell: "figures", figures });
  }
  if (!figures?.ended) timer = setTimeout(turn, 1000 * wait);
}

onmessage = ({ data }) => {
  clearTimeout(timer);
  port?.close();
  ({ port } = data);
  port.onmessage = ({ data: wish }) => here.ask(wish);
  begin(data.settings);
};

load().catch((error) => tell({ tell: "wrong", text: `The flight cannot be loaded: ${error.message}` }));
