import assert from "node:assert/strict";
import { test } from "node:test";
import { parse, wcagContrast } from "culori";
import { CONTRAST_LEAST, GROUNDS, leastDifference } from "../palette.mjs";
import { PALETTE } from "../src/palette.js";
import { textOn } from "../src/theme.js";

const OKABE_ITO = ["#e69f00", "#56b4e9", "#009e73", "#0072b2", "#d55e00", "#cc79a7", "#f0e442", "#000000"];

test("twelve vehicles are farther apart for everybody than the eight colours of Okabe and Ito, and sixteen nearly as far", () => {
  const known = leastDifference(OKABE_ITO);
  for (const colours of Object.values(PALETTE)) {
    assert.equal(new Set(colours).size, 16);
    assert.ok(leastDifference(colours.slice(0, 12)) > known, `${leastDifference(colours.slice(0, 12))}, ${known}`);
    assert.ok(leastDifference(colours) > 0.9 * known, `${leastDifference(colours)}, ${known}`);
  }
});

test("every colour is seen on its ground, and what is written on it is read", () => {
  for (const [name, colours] of Object.entries(PALETTE)) {
    for (const colour of colours) {
      assert.ok(wcagContrast(parse(colour), GROUNDS[name]) >= CONTRAST_LEAST, colour);
      assert.ok(wcagContrast(parse(colour), textOn(colour)) >= 4.5, colour);
    }
  }
});
