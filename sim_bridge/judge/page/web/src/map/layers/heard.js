// The vehicles of the watched swarm, as their beacons report them: each in its colour, the leader a diamond, a ghost hollow and dashed.
import { textOn, vehicleColour } from "../../theme.js";
import { FRESH_S, age, leads } from "../../../watch/picture.js";
import { circle } from "../shapes.js";

const REACH_PX = 30; // of a finger
const AHEAD_S = 3; // of the line along the velocity

export const heard = {
  name: "heard",
  needs: ["vehicles"],

  draw(ctx, view, { ink, vehicles, selected, labels }) {
    for (const one of vehicles) if (one.enu) drawVehicle(ctx, view, one, { ink, labels, chosen: one.id === selected });
  },

  // Number of the vehicle there.
  hit(view, { vehicles }, px, py) {
    return vehicles[view.nearest(vehicles.map(({ enu }) => enu), px, py, REACH_PX)]?.id ?? null;
  },
};

function drawVehicle(ctx, view, one, { ink, labels, chosen }) {
  const [x, y] = [view.x(one.enu[0]), view.y(one.enu[1])];
  const fresh = one.age_s < FRESH_S;
  if (fresh && one.airborne) drawVelocity(ctx, view, one, ink);
  if (!one.place && one.leader_sd_m) drawUncertainty(ctx, view, one, ink);
  const colour = vehicleColour(one.id - 1);
  drawMark(ctx, x, y, { fresh, chosen, leading: leads(one), ink, colour });
  ctx.textAlign = "center";
  ctx.fillStyle = fresh ? textOn(colour) : ink.ink;
  ctx.fillText(String(one.id), x, y + 1);
  if (!fresh) labels.write(`${age(one.age_s)} ago`, x + 22, y, "left");
}

function drawMark(ctx, x, y, { fresh, chosen, leading, ink, colour }) {
  ctx.beginPath();
  if (leading) {
    for (const [dx, dy] of [[0, -19], [19, 0], [0, 19], [-19, 0]]) ctx.lineTo(x + dx, y + dy);
    ctx.closePath();
  } else ctx.arc(x, y, 14, 0, 2 * Math.PI);
  const edge = fresh ? ink.ground : ink.alarm;
  ctx.fillStyle = fresh ? colour : ink.ground;
  ctx.fill();
  ctx.setLineDash(fresh ? [] : [5, 4]);
  ctx.lineWidth = chosen ? 5 : 3;
  ctx.strokeStyle = chosen ? ink.ink : edge;
  ctx.stroke();
  ctx.setLineDash([]);
}

function drawVelocity(ctx, view, { enu: [e, n], vel_ned_mps: [north, east] }, ink) {
  ctx.strokeStyle = ink.ink;
  ctx.lineWidth = 3;
  ctx.beginPath();
  ctx.moveTo(view.x(e), view.y(n));
  ctx.lineTo(view.x(e + AHEAD_S * east), view.y(n + AHEAD_S * north));
  ctx.stroke();
}

// Two standard deviations.
function drawUncertainty(ctx, view, one, ink) {
  ctx.strokeStyle = ink.accent;
  ctx.lineWidth = 2;
  circle(ctx, view, one.enu, Math.max(18, 2 * one.leader_sd_m * view.scale));
  ctx.stroke();
}
