// What the page says in words and figures.
import { Plane } from "../src/map/plane.js";

const metres = (value) => (Math.abs(value) < 0.05 ? "0.0" : value.toFixed(1));

// East and north of the origin, and latitude and longitude where the mission says where that is.
export function coordinates([east, north], origin) {
  const local = `${metres(east)} m east, ${metres(north)} m north`;
  if (!Number.isFinite(origin?.lat_deg) || !Number.isFinite(origin?.lon_deg)) return local;
  const [lat, lon] = new Plane(origin.lat_deg, origin.lon_deg).wgs84([east, north]);
  return `${local} · ${lat.toFixed(6)}, ${lon.toFixed(6)}`;
}

export function treeText(trees, i) {
  const named = [trees.id[i], trees.species[i]].filter(Boolean).join(", ") || "tree";
  return `${named}, ${(200 * trees.radius_m[i]).toFixed(0)} cm, ${trees.height_m[i].toFixed(0)} m tall`;
}

// What to do next, for somebody who has never seen the page.
export function hintOf(tool, points, fence) {
  if (tool === "d1") return "Click where the swarm starts. In the red area a tree would stand in its starting places.";
  if (tool === "d2") return "Click the tree to visit: the swarm spreads around it.";
  if (tool === "stop") return "Click a tree to visit on the way.";
  if (tool === "fence") return fence.length < 3 ? `Click the corners of the fence: ${3 - fence.length} more at least.` : "Click to add a corner to the nearest side. Drag corners, or press Delete on one.";
  if (!points[0].enu) return "Choose d1, and click where the swarm starts.";
  if (!points.at(-1).enu) return "Choose d2, and click the tree to visit.";
  return "Drag points and corners; drag the ground to move the map.";
}

// The state of the check in a line, and whether it is good.
export function verdictOf(state) {
  const { problems, beyond } = state;
  if (problems.length) return { good: false, text: `Does not check: ${problems.length === 1 ? "1 problem" : `${problems.length} problems`}` };
  return { good: true, text: beyond.length ? "Checks, but not for the simulator" : "Checks" };
}

export function diskText(state) {
  if (state.disk === "changed") return `${state.file} was changed by another program since it was opened here.`;
  if (state.disk === "gone") return `${state.file} is not on the disk any more: saving writes it again.`;
  return "";
}

export function savedText(state) {
  if (state.is_saved) return "saved";
  return state.disk === "new" ? "new, not saved yet" : "not saved";
}

// A number as a field shows it; "" for none.
export function shownValue(value) {
  if (value === null || value === undefined) return "";
  return typeof value === "number" ? String(Number(value.toFixed(6))) : String(value);
}

// What a field's text means: { value }, { empty: true }, or { wrong: true }.
export function readValue(kind, text) {
  if (kind === "string") return { value: text };
  if (text.trim() === "") return { empty: true };
  if (kind === "choice") return { value: text };
  const number = Number(text.trim().replace(",", "."));
  return Number.isFinite(number) ? { value: number } : { wrong: true };
}
