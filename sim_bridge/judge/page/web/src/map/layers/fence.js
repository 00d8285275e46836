// The fence on the ground.
import { trace } from "../shapes.js";

export const fence = {
  name: "fence",
  needs: ["mission"],

  draw(ctx, view, { ink, style, mission }) {
    if (!mission.fence.length) return;
    trace(ctx, view, mission.fence, true);
    ctx.strokeStyle = ink.alarm;
    ctx.lineWidth = style.fence.width;
    ctx.setLineDash(style.fence.dash);
    ctx.stroke();
  },
};
