// A layer of the map is one object in one file of map/layers/:
//   name    that of its export in layers/index.js, and of its switch in the legend
//   needs   keys of the data without which it is not drawn; of `FLIGHT_KEYS` and `WATCH_KEYS`
//   draw    (ctx, view, data): a CanvasRenderingContext2D whose state is put back afterwards, a View, and the data
//   legend  { text, order, shown, has(replay) }: its switch on the page of a flight; none: it is always shown
//   hit     (view, data, px, py): what of it is at a pixel, or null
//   still   true: it changes with the view only, and is not drawn anew for each frame
// The data always have `ink` (colours by name), `style` (map/style.js) and `selected`. A page's map lists its layers, the lowest first.

// Of the page of a flight (map/flightmap.js). ENU metres.
export const FLIGHT_KEYS = ["replay", "mission", "time", "at", "chart", "plane", "against"]; // `at`: row and share of the next; none before the first row. `chart`, `against`: where the page has one
// Of the page of `companion watch` (watch/watchmap.js). `vehicles` and `peerReports` with their `enu`, `chart` with its `plane`.
export const WATCH_KEYS = ["mission", "vehicles", "peerReports", "chart", "plane"];

const KEYS = new Set(["name", "needs", "draw", "legend", "hit", "still"]);

export function checked(layer) {
  const wrong = Object.keys(layer).find((key) => !KEYS.has(key));
  if (wrong) throw new Error(`layer ${layer.name}: ${wrong} is no part of a layer`);
  if (!layer.name || !Array.isArray(layer.needs) || typeof layer.draw !== "function") throw new Error(`layer ${layer.name}: name, needs, draw are wanted`);
  return layer;
}

// The switches of the layers that have one and of `options`, in their order.
export function legendOf(layers, options, replay) {
  return [...layers.filter(({ legend }) => legend).map(({ name, legend }) => ({ name, ...legend })), ...options]
    .filter(({ has }) => !has || has(replay))
    .sort((a, b) => a.order - b.order);
}
