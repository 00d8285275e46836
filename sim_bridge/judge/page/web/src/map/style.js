// How large the layers that pages share are drawn: for a desk, and for a tablet at arm's length in the sun.
import { Labels } from "./labels.js";

export const DESK = {
  pen: { lineJoin: "round", font: "12px system-ui, sans-serif" },
  gridPx: 90,
  fence: { dash: [2, 4], width: 1.2 },
  place: { sizePx: 5, width: 1.5 },
  scalePx: 70,
  north: { x: 24, y: 84, sizePx: 11 },
};

export const FIELD = {
  pen: { lineJoin: "round", font: "600 16px system-ui, sans-serif", textBaseline: "middle" },
  gridPx: 80,
  fence: { dash: [10, 6], width: 3 },
  place: { sizePx: 8, width: 3 },
  scalePx: 100,
  north: { x: 28, y: 40, sizePx: 15 },
  labels: (ctx, view, ink) => new Labels(ctx, view, ink), // that keep clear of each other
};
