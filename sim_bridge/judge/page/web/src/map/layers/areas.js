// The rings to be covered.
import { circle } from "../shapes.js";

export const areas = {
  name: "areas",
  needs: ["mission"],

  draw(ctx, view, { ink, mission: { coverage } }) {
    ctx.strokeStyle = ink.faint;
    ctx.lineWidth = 1.2;
    ctx.setLineDash([6, 4]);
    for (const centre of coverage.centres_enu_m) {
      circle(ctx, view, centre, coverage.radius_m * view.scale);
      ctx.stroke();
    }
  },
};
