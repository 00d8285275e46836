// From each vehicle of the watched swarm to the neighbour that it says it follows.
import { FRESH_S } from "../../../watch/picture.js";
import { trace } from "../shapes.js";

export const following = {
  name: "following",
  needs: ["vehicles"],

  draw(ctx, view, { ink, vehicles }) {
    const byId = new Map(vehicles.filter(({ enu }) => enu).map((one) => [one.id, one]));
    ctx.strokeStyle = ink.link;
    ctx.lineWidth = 2;
    for (const one of byId.values()) {
      const parent = byId.get(one.parent);
      if (!parent) continue;
      ctx.setLineDash(one.age_s < FRESH_S ? [] : [3, 7]);
      trace(ctx, view, [one.enu, parent.enu]);
      ctx.stroke();
    }
  },
};
