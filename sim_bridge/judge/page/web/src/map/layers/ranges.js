// Radio range of the selected vehicle, else of the leader.
import { reach } from "../../shadow.js";
import { circle, trace } from "../shapes.js";

export const ranges = {
  name: "ranges",
  needs: ["replay", "at"],
  legend: { text: "radio range", order: 4, shown: true },

  draw(ctx, view, { ink, replay, at, selected }) {
    const k = selected ?? replay.swarm.leader[at.row] - 1;
    if (k < 0 || !replay.vehicles[k].alive[at.row]) return;
    const [east, north] = replay.place(k, at);
    const range = replay.vehicles[k].range_m[at.row];
    const factor = replay.attenuationFactor;
    ctx.fillStyle = ink.radio;
    ctx.strokeStyle = ink.radioEdge;
    ctx.lineWidth = 1;
    trace(ctx, view, reach(replay.trees, east, north, range, factor), true);
    ctx.fill();
    ctx.globalAlpha = factor < 1 ? 0.3 : 1; // trunks make it ragged
    ctx.stroke();
    if (factor >= 1) return;
    ctx.globalAlpha = 1;
    ctx.setLineDash([1, 5]);
    circle(ctx, view, [east, north], range * view.scale);
    ctx.stroke();
  },
};
