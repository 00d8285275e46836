// Paths that several layers draw.
const ROUND_FROM_PX = 1.5; // of a radius: below, a square looks the same

// Through [east, north] positions.
export function trace(ctx, view, points, closed = false) {
  ctx.beginPath();
  for (const [e, n] of points) ctx.lineTo(view.x(e), view.y(n));
  if (closed) ctx.closePath();
}

// A circle about [east, north], of so many pixels.
export function circle(ctx, view, [e, n], radiusPx) {
  ctx.beginPath();
  ctx.arc(view.x(e), view.y(n), radiusPx, 0, 2 * Math.PI);
}

// Circles of a table's rows that are in view, filled. `radius(row)`: metres; 0: none.
export function fillDiscs(ctx, view, table, radius, leastPx) {
  ctx.beginPath();
  for (let i = 0; i < table.east_m.length; i++) {
    const metres = radius(i);
    if (metres <= 0) continue;
    const px = Math.max(leastPx, metres * view.scale);
    const [x, y] = [view.x(table.east_m[i]), view.y(table.north_m[i])];
    if (x < -px || y < -px || x > view.width + px || y > view.height + px) continue;
    if (px < ROUND_FROM_PX) {
      ctx.rect(x - px, y - px, 2 * px, 2 * px);
      continue;
    }
    ctx.moveTo(x + px, y);
    ctx.arc(x, y, px, 0, 2 * Math.PI);
  }
  ctx.fill();
}
