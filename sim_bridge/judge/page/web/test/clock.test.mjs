import assert from "node:assert/strict";
import { test } from "node:test";
import { Clock } from "../src/clock.js";
import { LiveClock } from "../src/live.js";
import { setUpBrowser } from "./kit.mjs";

function playing(clock = new Clock(0, 10)) {
  const { nextFrame } = setUpBrowser();
  const heard = [];
  clock.listen((time) => heard.push(time));
  clock.speed = 2;
  clock.toggle();
  clock.last = 0;
  return { clock, nextFrame, heard };
}

test("it plays as fast as it is told, and jumps not after the page was hidden", () => {
  const { clock, nextFrame } = playing();
  nextFrame(50);
  assert.ok(Math.abs(clock.time - 0.1) < 1e-9);
  nextFrame(60_050);
  assert.ok(Math.abs(clock.time - 0.3) < 1e-9);
});

test("it stops at the end, and plays from the start after it", () => {
  const { clock, nextFrame } = playing(new Clock(0, 0.15));
  nextFrame(90);
  assert.deepEqual([clock.time, clock.playing, clock.label], [0.15, false, "Play"]);
  clock.toggle();
  assert.deepEqual([clock.time, clock.label], [0, "Pause"]);
});

test("who listens is told once a frame", () => {
  const { clock, nextFrame, heard } = playing();
  clock.toggle();
  for (const time of [3, 4, 99]) clock.seek(time);
  nextFrame(10);
  assert.deepEqual(heard, [10]);
});

test("a step is a tenth of a second, from a round one, and stops it", () => {
  const { clock } = playing();
  clock.seek(1.234);
  clock.step(0.1);
  assert.deepEqual([clock.time, clock.playing], [1.3, false]);
});

test("the clock of a flight under way follows its newest row until somebody goes elsewhere", () => {
  const { nextFrame } = setUpBrowser();
  const clock = new LiveClock({ start: 0, end: 10 });
  clock.grew(0, 20);
  for (let now = 0; now < 3000; now += 100) nextFrame(now);
  assert.equal(clock.time, 20);
  clock.seek(4);
  clock.grew(0, 30);
  nextFrame(4000);
  assert.deepEqual([clock.time, clock.label], [4, "Live"]);
  clock.toggle();
  for (let now = 4000; now < 7000; now += 100) nextFrame(now);
  assert.deepEqual([clock.time, clock.label], [30, "Freeze view"]);
  clock.finish();
  assert.equal(clock.label, "Play");
});

test("a moment that is forgotten is not shown any more", () => {
  setUpBrowser();
  const clock = new LiveClock({ start: 0, end: 10 });
  clock.seek(1);
  clock.grew(5, 20);
  assert.equal(clock.time, 5);
});
