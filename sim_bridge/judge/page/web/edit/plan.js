// What a mission's values say of places, and the changes that move them. Pure: no page, no server.
const MAP_DIGITS = 1; // of a place that is clicked; of a tree's, as its map has it
const FENCE_ROOM_M = 12; // around what must be inside: the slack that the rules ask for, and some more
const VERTICES_MAX = 64;

const isPoint = (at, size) => Array.isArray(at) && at.length === size && at.every((one) => Number.isFinite(one));
const rounded = (value, digits = MAP_DIGITS) => Number(value.toFixed(digits));
const path = (...parts) => parts;

// d1, stops, d2: name, key as in refusals, path, and [east, north, up], null where it is not said (well).
export function pointsOf(values) {
  const route = values.route ?? {};
  const stops = Array.isArray(route.stops) ? route.stops : [];
  const point = (name, key, where, at, about) => ({ name, key, path: where, enu: isPoint(at, 3) ? at : null, about });
  return [
    point("d1", "route.d1_enu_m", path("route", "d1_enu_m"), route.d1_enu_m, "start"),
    ...stops.map((stop, k) => point(`stop ${k + 1}`, `route.stops[${k}].pos_enu_m`, path("route", "stops", k, "pos_enu_m"), stop?.pos_enu_m, "on the way")),
    point("d2", "route.d2_enu_m", path("route", "d2_enu_m"), route.d2_enu_m, "destination"),
  ];
}

export function fenceOf(values) {
  const polygon = values.fence?.polygon_enu_m;
  return Array.isArray(polygon) ? polygon.filter((at) => isPoint(at, 2)) : [];
}

// The height that a new point gets: as high as the others, or what the server proposes.
export function heightFor(values, proposed) {
  return pointsOf(values).find(({ enu }) => enu)?.enu[2] ?? proposed;
}

const set = (where, value) => ({ do: "set", path: where, value });
const remove = (where) => ({ do: "remove", path: where });
const insert = (where, value) => ({ do: "insert", path: where, value });

// d1 or d2 at [east, north], or a point moved there; one that was named by its tree is not any more.
export function moveTo(values, point, [east, north], proposed, digits) {
  const up = point.enu?.[2] ?? heightFor(values, proposed);
  const named = { d1: "d1_tree", d2: "d2_tree" }[point.name];
  const changes = [set(point.path, [rounded(east, digits), rounded(north, digits), up])];
  if (named && values.route?.[named] !== undefined) changes.push(remove(path("route", named)));
  return changes;
}

// A stop where the way grows least by it.
export function addStop(values, [east, north], proposed, digits) {
  const known = pointsOf(values);
  const at = [rounded(east, digits), rounded(north, digits), heightFor(values, proposed)];
  let [best, least] = [known.length - 2, Infinity];
  for (let k = 0; k + 1 < known.length; k++) {
    const [a, b] = [known[k].enu, known[k + 1].enu];
    if (!a || !b) continue;
    const grows = away(a, at) + away(at, b) - away(a, b);
    if (grows < least) [best, least] = [k, grows];
  }
  return [insert(path("route", "stops", best), { pos_enu_m: at })];
}

export function removeStop(k) {
  return [remove(path("route", "stops", k))];
}

const away = (a, b) => Math.hypot(a[0] - b[0], a[1] - b[1]);
const FENCE = path("fence", "polygon_enu_m");

export function setFence(polygon) {
  return polygon.length ? [set(FENCE, polygon.map((at) => at.map((one) => rounded(one))))] : [remove(FENCE)];
}

// A corner more, in the edge that it is nearest to.
export function withVertex(polygon, at) {
  if (polygon.length >= VERTICES_MAX) return polygon;
  if (polygon.length < 3) return [...polygon, at];
  let [best, least] = [polygon.length, Infinity];
  polygon.forEach((a, k) => {
    const off = offSegment(at, a, polygon[(k + 1) % polygon.length]);
    if (off < least) [best, least] = [k + 1, off];
  });
  return [...polygon.slice(0, best), at, ...polygon.slice(best)];
}

export function offSegment([x, y], [ax, ay], [bx, by]) {
  const [dx, dy] = [bx - ax, by - ay];
  const length2 = dx * dx + dy * dy;
  const share = length2 ? Math.max(0, Math.min(1, ((x - ax) * dx + (y - ay) * dy) / length2)) : 0;
  return Math.hypot(x - ax - share * dx, y - ay - share * dy);
}

// A rectangle around all points with what they take: starting places at d1, the ring elsewhere. `radii`: { start, ring }, m.
export function fenceAround(points, radii) {
  const known = points.filter(({ enu }) => enu);
  if (!known.length) return [];
  const room = (name) => (name === "d1" ? radii.start : radii.ring) + FENCE_ROOM_M;
  const west = Math.floor(Math.min(...known.map(({ name, enu }) => enu[0] - room(name))));
  const east = Math.ceil(Math.max(...known.map(({ name, enu }) => enu[0] + room(name))));
  const south = Math.floor(Math.min(...known.map(({ name, enu }) => enu[1] - room(name))));
  const north = Math.ceil(Math.max(...known.map(({ name, enu }) => enu[1] + room(name))));
  return [[west, south], [east, south], [east, north], [west, north]];
}

// Where n vehicles stand on the ring about `to` when they are spread evenly, the first where they come from.
export function ringSpots([east, north], radius, n, from) {
  const first = from ? Math.atan2(from[1] - north, from[0] - east) : 0;
  return Array.from({ length: Math.min(n, 250) }, (_, k) => {
    const angle = first + (2 * Math.PI * k) / n;
    return [east + radius * Math.cos(angle), north + radius * Math.sin(angle)];
  });
}

// Index of the tree whose axis is nearest to [east, north], within `reach` m; null: none.
export function nearestTree(trees, [east, north], reach) {
  let [best, least] = [null, reach];
  for (let i = 0; i < trees.east_m.length; i++) {
    const off = Math.max(0, Math.hypot(trees.east_m[i] - east, trees.north_m[i] - north) - trees.radius_m[i]);
    if (off < least) [best, least] = [i, off];
  }
  return best;
}

// Trees that stand in the starting places about d1, which `clear` m around it must be free of.
export function treesInTheWay(trees, at, clear) {
  const gap = (i) => Math.hypot(trees.east_m[i] - at[0], trees.north_m[i] - at[1]) - trees.radius_m[i];
  return trees.east_m.map((_, i) => i).filter((i) => gap(i) < clear);
}

// The field, point or fence that a refusal's key is about: { field }, { point }, { fence: true }; null: none on this page.
export function subjectOf(key, fields) {
  if (fields.has(key)) return { field: key };
  if (key.startsWith("fence.polygon_enu_m")) return { fence: true };
  const stop = /^route\.stops\[(\d+)\]/.exec(key);
  if (stop) return { point: `stop ${Number(stop[1]) + 1}` };
  const end = /^route\.(d[12])_(enu_m|tree)/.exec(key);
  if (end) return { point: end[1] };
  if (key === "forest.file") return { stems: true };
  if (/stands? .*from d1|^the tree at/.test(key)) return { tree: treeAt(key) };
  return null;
}

// "the tree at 3.00 east, -2.50 north" -> [3, -2.5]
export function treeAt(key) {
  const found = /^the tree at (-?[\d.]+) east, (-?[\d.]+) north/.exec(key);
  return found && [Number(found[1]), Number(found[2])];
}
