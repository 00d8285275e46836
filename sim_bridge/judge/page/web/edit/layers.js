// Layers of the map that plans: src/map/layer.js says what a layer is. `plan`: of editmap.js.
import { reach } from "../src/shadow.js";
import { circle, fillDiscs, trace } from "../src/map/shapes.js";

const CONTOUR_PX = 70; // between two lines of equal height, about
const HANDLE_PX = 9;
const CORNER_PX = 6;
const SCALE_LEFT_PX = 30; // what the bar of the scale takes at the lower left, besides its length
const SCALE_HIGH_PX = 40;
const STEM_PX = 2.2; // at least
const HIT_PX = 18; // as far as a finger is off

// Lines of equal height of a ground that slopes.
const contours = {
  name: "contours",
  needs: ["stand"],
  still: true,

  draw(ctx, view, { ink, stand: { grade: [ge, gn] } }) {
    const slope = Math.hypot(ge, gn);
    if (slope === 0) return;
    const step = view.roundMetres(CONTOUR_PX * slope);
    const [de, dn] = [ge / slope, gn / slope];
    const middle = ge * view.east + gn * view.north;
    const far = Math.hypot(view.width, view.height) / view.scale;
    ctx.strokeStyle = ctx.fillStyle = ink.contour;
    ctx.lineWidth = 1;
    for (let up = Math.ceil((middle - far * slope) / step) * step; up <= middle + far * slope; up += step) {
      const off = (up - middle) / slope;
      const [e, n] = [view.east + off * de, view.north + off * dn];
      trace(ctx, view, [[e - far * dn, n + far * de], [e + far * dn, n - far * de]]);
      ctx.stroke();
      ctx.fillText(`${up > 0 ? "+" : ""}${Number(up.toFixed(2))} m`, view.x(e) + 4, view.y(n) - 4);
    }
  },
};

// Stems, large enough to be seen and clicked; what lies on the ground below them.
const stems = {
  name: "stems",
  needs: ["stand"],
  still: true,

  draw(ctx, view, { ink, stand: { trees, bushes } }) {
    ctx.fillStyle = ink.bush;
    fillDiscs(ctx, view, bushes, (i) => bushes.radius_m[i], 0);
    ctx.fillStyle = ink.trunk;
    fillDiscs(ctx, view, trees, (i) => trees.radius_m[i], STEM_PX);
  },
};

// Where d1 cannot be: a tree would stand in its starting places.
const noRoom = {
  name: "noRoom",
  needs: ["stand", "room"],

  draw(ctx, view, { ink, stand: { trees }, room }) {
    ctx.fillStyle = ink.noRoom;
    fillDiscs(ctx, view, trees, (i) => trees.radius_m[i] + room, 0);
  },
};

// Metres at the lines of the grid: east below, north at the left.
const gridNumbers = {
  name: "gridNumbers",
  needs: [],

  draw(ctx, view, { ink, style }) {
    const step = view.roundMetres(style.gridPx);
    const [[west, south], [east, up]] = [view.enu(0, view.height), view.enu(view.width, 0)];
    ctx.font = "11px system-ui, sans-serif";
    const scale = SCALE_LEFT_PX + view.roundMetres(style.scalePx) * view.scale; // the bar's
    for (let e = Math.ceil(Math.max(west, view.enu(scale, 0)[0]) / step) * step; e <= east; e += step) label(ctx, ink, String(Number(e.toFixed(2))), view.x(e), view.height - 4, ink.muted);
    ctx.textAlign = "left";
    for (let n = Math.ceil(Math.max(south, view.enu(0, view.height - SCALE_HIGH_PX)[1]) / step) * step; n <= up; n += step) label(ctx, ink, String(Number(n.toFixed(2))), 4, view.y(n) + 4, ink.muted);
  },
};

const inTheWay = {
  name: "inTheWay",
  needs: ["plan"],

  draw(ctx, view, { ink, plan, stand }) {
    ctx.strokeStyle = ink.alarm;
    ctx.fillStyle = ink.alarm;
    for (const i of plan.blocking) {
      circle(ctx, view, [stand.trees.east_m[i], stand.trees.north_m[i]], Math.max(4, stand.trees.radius_m[i] * view.scale));
      ctx.fill();
    }
    ctx.lineWidth = 3;
    for (const at of plan.accused) {
      circle(ctx, view, at, 10);
      ctx.stroke();
    }
  },
};

// How far the radio carries: on the way about d1, and at full power about d2, behind trunks as they attenuate it.
const radio = {
  name: "radio",
  needs: ["plan"],

  draw(ctx, view, { ink, plan, stand }) {
    ctx.fillStyle = ink.radio;
    ctx.strokeStyle = ink.radioEdge;
    for (const { at, range, name } of plan.reaches) {
      trace(ctx, view, stand && plan.attenuation < 1 ? reach(stand.trees, at[0], at[1], range, plan.attenuation) : reach({ east_m: [] }, at[0], at[1], range, 1), true);
      ctx.lineWidth = 1;
      ctx.setLineDash([]);
      ctx.fill();
      ctx.setLineDash([2, 5]);
      circle(ctx, view, at, range * view.scale);
      ctx.stroke();
      ctx.fillStyle = ink.radioEdge;
      ctx.textAlign = "center";
      ctx.fillText(`radio ${name}, ${range} m`, view.x(at[0]), view.y(at[1] - range) + 15);
      ctx.fillStyle = ink.radio;
    }
  },
};

// Where the swarm starts, and what must be free of trees for it.
const start = {
  name: "start",
  needs: ["plan"],

  draw(ctx, view, { ink, plan }) {
    if (!plan.start) return;
    const { at, radius, clear } = plan.start;
    ctx.strokeStyle = ink.accent;
    ctx.fillStyle = ink.startFill;
    ctx.lineWidth = 1.5;
    circle(ctx, view, at, radius * view.scale);
    ctx.fill();
    ctx.stroke();
    ctx.setLineDash([3, 4]);
    ctx.lineWidth = 1;
    circle(ctx, view, at, clear * view.scale);
    ctx.stroke();
  },
};

// The ring or sphere at each place that is visited, and where vehicles stand on it once they are spread evenly.
const rings = {
  name: "rings",
  needs: ["plan"],

  draw(ctx, view, { ink, plan }) {
    ctx.strokeStyle = ink.ring;
    for (const { at, radius, keepOut, spots } of plan.rings) {
      ctx.lineWidth = 1.6;
      ctx.setLineDash([6, 4]);
      circle(ctx, view, at, radius * view.scale);
      ctx.stroke();
      ctx.setLineDash([1, 3]);
      circle(ctx, view, at, keepOut * view.scale);
      ctx.stroke();
      ctx.setLineDash([]);
      ctx.fillStyle = ink.ring;
      for (const spot of spots) {
        circle(ctx, view, spot, 3.5);
        ctx.fill();
      }
    }
  },
};

const route = {
  name: "route",
  needs: ["plan"],

  draw(ctx, view, { ink, plan }) {
    const known = plan.points.filter(({ enu }) => enu);
    for (const [width, colour] of [[6, ink.halo], [2.5, ink.route]]) {
      ctx.lineWidth = width;
      ctx.strokeStyle = colour;
      ctx.setLineDash([]);
      trace(ctx, view, known.map(({ enu }) => enu));
      ctx.stroke();
      if (!plan.comesBack || known.length < 2) continue;
      ctx.setLineDash([8, 7]);
      trace(ctx, view, [known.at(-1).enu, known[0].enu]);
      ctx.stroke();
    }
    ctx.setLineDash([]);
    ctx.fillStyle = ink.route;
    for (let k = 0; k + 1 < known.length; k++) arrow(ctx, view, known[k].enu, known[k + 1].enu);
  },
};

function arrow(ctx, view, a, b) {
  const [x, y] = [view.x((a[0] + b[0]) / 2), view.y((a[1] + b[1]) / 2)];
  const angle = Math.atan2(view.y(b[1]) - view.y(a[1]), view.x(b[0]) - view.x(a[0]));
  const tip = (turn, px) => [x + px * Math.cos(angle + turn), y + px * Math.sin(angle + turn)];
  ctx.beginPath();
  for (const [px, py] of [tip(0, 9), tip(2.5, 9), tip(-2.5, 9)]) ctx.lineTo(px, py);
  ctx.fill();
}

const fence = {
  name: "fence",
  needs: ["plan"],

  draw(ctx, view, { ink, plan }) {
    if (!plan.fence.length) return;
    for (const [width, colour] of [[5, ink.halo], [2, ink.alarm]]) {
      ctx.lineWidth = width;
      ctx.strokeStyle = colour;
      ctx.setLineDash(width > 2 ? [] : [9, 5]);
      trace(ctx, view, plan.fence, true);
      ctx.stroke();
    }
  },
};

const corners = {
  name: "corners",
  needs: ["plan"],

  draw(ctx, view, { ink, plan, selected }) {
    ctx.lineWidth = 2;
    plan.fence.forEach(([e, n], k) => {
      const chosen = selected?.corner === k;
      const px = CORNER_PX + (chosen ? 3 : 0);
      ctx.fillStyle = chosen ? ink.alarm : ink.halo;
      ctx.strokeStyle = ink.alarm;
      ctx.beginPath();
      ctx.rect(view.x(e) - px, view.y(n) - px, 2 * px, 2 * px);
      ctx.fill();
      ctx.stroke();
    });
  },

  hit(view, { plan }, px, py) {
    const corner = view.nearest(plan.fence, px, py, HIT_PX);
    return corner === null ? null : { corner };
  },
};

const handles = {
  name: "handles",
  needs: ["plan"],

  draw(ctx, view, { ink, plan, selected }) {
    ctx.textAlign = "center";
    ctx.font = "600 13px system-ui, sans-serif";
    for (const { name, enu, about } of plan.points) {
      if (!enu) continue;
      const [x, y] = [view.x(enu[0]), view.y(enu[1])];
      const chosen = selected?.point === name;
      ctx.lineWidth = 3;
      ctx.strokeStyle = ink.halo;
      ctx.fillStyle = plan.bad.has(name) ? ink.alarm : ink.accent;
      ctx.beginPath();
      ctx.arc(x, y, HANDLE_PX + (chosen ? 4 : 0), 0, 2 * Math.PI);
      ctx.fill();
      ctx.stroke();
      label(ctx, ink, `${name} · ${about}`, x, y - HANDLE_PX - 8);
    }
  },

  hit(view, { plan }, px, py) {
    const k = view.nearest(plan.points.map(({ enu }) => enu), px, py, HIT_PX);
    return k === null ? null : { point: plan.points[k].name };
  },
};

function label(ctx, ink, text, x, y, colour = ink.ink) {
  ctx.lineWidth = 4;
  ctx.strokeStyle = ink.halo;
  ctx.strokeText(text, x, y);
  ctx.fillStyle = colour;
  ctx.fillText(text, x, y);
}

// The middle of the map, where Enter places a point.
const crosshair = {
  name: "crosshair",
  needs: ["plan"],

  draw(ctx, view, { ink, plan }) {
    if (!plan.aims) return;
    const [x, y] = [view.width / 2, view.height / 2];
    ctx.strokeStyle = ink.ink;
    ctx.lineWidth = 1.5;
    ctx.beginPath();
    for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
      ctx.moveTo(x + 6 * dx, y + 6 * dy);
      ctx.lineTo(x + 20 * dx, y + 20 * dy);
    }
    ctx.stroke();
  },
};

export { contours, corners, crosshair, fence, gridNumbers, handles, inTheWay, noRoom, radio, rings, route, start, stems };
