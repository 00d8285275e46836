import assert from "node:assert/strict";
import { test } from "node:test";
import { View, bounds, viewOf } from "../src/map/view.js";

const VIEW = new View({ east: 100, north: 50, scale: 4 }, 200, 100);

test("east is right, north is up, the middle is the middle", () => {
  assert.deepEqual([VIEW.x(100), VIEW.y(50)], [100, 50]);
  assert.deepEqual([VIEW.x(110), VIEW.y(60)], [140, 10]);
});

test("a pixel's position is the pixel of that position", () => {
  const [e, n] = VIEW.enu(17, 83);
  assert.deepEqual([VIEW.x(e), VIEW.y(n)], [17, 83]);
});

test("what lies under the pointer stays there when it is zoomed", () => {
  const before = VIEW.enu(30, 90);
  const after = VIEW.zoomed(2.5, 30, 90).enu(30, 90);
  after.forEach((value, k) => assert.ok(Math.abs(value - before[k]) < 1e-9));
});

test("zoom ends at both ends", () => {
  assert.equal(VIEW.zoomed(1e9).scale, 400);
  assert.equal(VIEW.zoomed(1e-9).scale, 0.02);
});

test("what is dragged follows the finger", () => {
  const moved = VIEW.panned(20, -8);
  assert.deepEqual([moved.x(100), moved.y(50)], [120, 42]);
  assert.deepEqual([VIEW.east, VIEW.north], [100, 50]);
});

test("scale bars are of round numbers of metres, and about as long as is wanted", () => {
  for (const scale of [0.02, 0.5, 3, 7, 40, 400]) {
    const metres = new View({ east: 0, north: 0, scale }, 200, 100).roundMetres(70);
    assert.match(metres.toExponential(), /^[125]e/);
    assert.ok(metres * scale >= 69 && metres * scale <= 180, `${metres} m at ${scale}`);
  }
});

test("a view of points holds them all", () => {
  const points = [[-30, 5], [70, 9], [10, -40]];
  const view = viewOf(points, 200, 100, { least: 10, free: (px) => px * 0.9 });
  assert.deepEqual(bounds(points), [-30, -40, 70, 9]);
  for (const [e, n] of points) {
    assert.ok(view.x(e) > 0 && view.x(e) < 200 && view.y(n) > 0 && view.y(n) < 100);
  }
});

test("a view of one point shows some metres around it", () => {
  assert.equal(viewOf([[3, 4]], 200, 100, { least: 10, free: (px) => px }).scale, 10);
});

test("the nearest position within reach is found, and none of null", () => {
  assert.equal(VIEW.nearest([null, [100, 50], [101, 50]], 104, 50, 22), 2);
  assert.equal(VIEW.nearest([null, [100, 50]], 150, 50, 22), null);
});
