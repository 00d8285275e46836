// Positions that autopilots estimate, with a line from the true ones.
import { vehicleColour } from "../../theme.js";
import { circle, trace } from "../shapes.js";

export const estimates = {
  name: "estimates",
  needs: ["replay", "at"],
  legend: { text: "estimates", order: 6, shown: false, has: (replay) => replay.vehicles.some((one) => one.estimate_off) },

  draw(ctx, view, { replay, at }) {
    ctx.lineWidth = 1.2;
    ctx.setLineDash([3, 2]);
    replay.vehicles.forEach((one, k) => {
      const error = one.alive[at.row] ? one.estimate_off : null;
      if (!error || Number.isNaN(error.east_m[at.row])) return;
      const [east, north] = replay.place(k, at);
      const estimate = [east + error.east_m[at.row], north + error.north_m[at.row]];
      ctx.strokeStyle = vehicleColour(k);
      trace(ctx, view, [[east, north], estimate]);
      ctx.stroke();
      circle(ctx, view, estimate, 6);
      ctx.stroke();
    });
  },
};
