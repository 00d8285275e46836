// The vehicles of a flight: which way they head, who leads, who is selected, who is silent.
import { vehicleColour } from "../../theme.js";

const REACH_PX = 22; // of a pointer
const CROWD = 30; // vehicles: with more, not each has its number

export const vehicles = {
  name: "vehicles",
  needs: ["replay", "at"],

  draw(ctx, view, { ink, replay, at, selected }) {
    const count = replay.vehicles.length;
    const leader = replay.swarm.leader[at.row] - 1;
    ctx.textAlign = "center";
    ctx.textBaseline = "middle";
    replay.vehicles.forEach((one, k) => {
      const [east, north] = replay.place(k, at);
      const pen = { ctx, ink, x: view.x(east), y: view.y(north), size: count > 50 ? 5 : 7 };
      const [leads, chosen] = [k === leader, k === selected];
      drawMarks(pen, leads, chosen);
      drawVehicle(pen, one, at.row, vehicleColour(k));
      if (count <= CROWD || leads || chosen) drawName(pen, leads ? `${k + 1} leads` : `${k + 1}`, leads);
    });
  },

  // Index of the vehicle there.
  hit(view, { replay, at }, px, py) {
    return view.nearest(replay.vehicles.map((_, k) => replay.place(k, at)), px, py, REACH_PX);
  },
};

function drawMarks({ ctx, ink, x, y, size }, leads, chosen) {
  if (leads) {
    ctx.strokeStyle = ink.leader;
    ctx.lineWidth = 2.5;
    ctx.beginPath();
    ctx.arc(x, y, size + 6, 0, 2 * Math.PI);
    ctx.stroke();
  }
  if (chosen) {
    ctx.strokeStyle = ink.ink;
    ctx.lineWidth = 1.5;
    ctx.strokeRect(x - size - 9, y - size - 9, 2 * size + 18, 2 * size + 18);
  }
}

// An arrow along its heading, or a disc where it has none; hollow and crossed: silent.
function drawVehicle({ ctx, ink, x, y, size }, { alive, yaw_deg: yaw }, row, colour) {
  ctx.fillStyle = alive[row] ? colour : ink.ground;
  ctx.strokeStyle = alive[row] ? ink.halo : colour;
  ctx.lineWidth = 1.5;
  ctx.beginPath();
  if (!yaw || Number.isNaN(yaw[row])) ctx.arc(x, y, size, 0, 2 * Math.PI);
  else {
    const angle = (yaw[row] * Math.PI) / 180;
    for (const [turn, far] of [[0, 1.5], [2.4, 1.15], [Math.PI, 0.45], [-2.4, 1.15]]) {
      ctx.lineTo(x + far * size * Math.sin(angle + turn), y - far * size * Math.cos(angle + turn));
    }
    ctx.closePath();
  }
  ctx.fill();
  ctx.stroke();
  if (alive[row]) return;
  ctx.strokeStyle = ink.alarm;
  ctx.lineWidth = 2.5;
  ctx.beginPath();
  for (const sign of [-1, 1]) {
    ctx.moveTo(x - size, y - sign * size);
    ctx.lineTo(x + size, y + sign * size);
  }
  ctx.stroke();
}

function drawName({ ctx, ink, x, y, size }, text, bold) {
  ctx.font = `${bold ? "700 " : ""}12px system-ui, sans-serif`;
  ctx.strokeStyle = ink.halo;
  ctx.lineWidth = 3;
  ctx.fillStyle = ink.ink;
  ctx.strokeText(text, x, y - size - 13);
  ctx.fillText(text, x, y - size - 13);
}
