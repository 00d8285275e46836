// Where vehicles were in the last seconds.
import { upTo } from "../../replay.js";
import { drawTracks } from "./tracks.js";

const TRAIL_S = 12;

export const trails = {
  name: "trails",
  needs: ["replay", "at"],
  legend: { text: "trails", order: 1, shown: true },

  draw(ctx, view, data) {
    if (!data.shown.tracks) drawTracks(ctx, view, data, { from: upTo(data.replay.time, data.time - TRAIL_S), stride: 1 });
  },
};
