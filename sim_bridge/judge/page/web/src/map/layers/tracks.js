// Where vehicles were since the start.
import { vehicleColour } from "../../theme.js";

const POINTS = 1500; // of a track, about

export const tracks = {
  name: "tracks",
  needs: ["replay", "at"],
  legend: { text: "whole tracks", order: 2, shown: false },

  draw(ctx, view, data) {
    drawTracks(ctx, view, data, { from: 0, stride: Math.max(1, Math.floor(data.at.row / POINTS)) });
  },
};

// From a row to now, every `stride` rows.
export function drawTracks(ctx, view, { replay, at, selected }, { from, stride }) {
  replay.vehicles.forEach((one, k) => {
    ctx.strokeStyle = vehicleColour(k);
    ctx.globalAlpha = selected === null || selected === k ? 0.8 : 0.25;
    ctx.lineWidth = 1.6;
    ctx.beginPath();
    for (let row = from; row <= at.row; row += stride) ctx.lineTo(view.x(one.east_m[row]), view.y(one.north_m[row]));
    const [east, north] = replay.place(k, at);
    ctx.lineTo(view.x(east), view.y(north));
    ctx.stroke();
  });
}
