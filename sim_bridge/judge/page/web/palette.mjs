// Writes src/palette.js: a colour for each vehicle, for light pages (and print) and for dark ones, as far apart as colours can be for
// everybody. `node palette.mjs`, after a change here; a test holds the file to what is wanted of it (test/palette.test.mjs).
import { differenceCiede2000, filterDeficiencyDeuter, filterDeficiencyProt, filterDeficiencyTrit, formatHex, lch, parse, wcagContrast } from "culori";
import { writeFile } from "node:fs/promises";
import { fileURLToPath } from "node:url";

export const GROUNDS = { light: "#ffffff", dark: "#11161a" }; // --ground of page.css
export const CONTRAST_LEAST = 3; // of a mark and what lies around it: WCAG 2.2, 1.4.11
export const FILE = fileURLToPath(new URL("src/palette.js", import.meta.url));
const COUNT = 16;
const STEP = 17; // of a channel, 0..255
const CONTRAST_MOST = 13; // more is taken for text
const CHROMA_LEAST = 22; // less is taken for a link, or for a vehicle that is silent
const STARTS = 24;

const difference = differenceCiede2000();
const EYES = [(colour) => colour, filterDeficiencyProt(1), filterDeficiencyDeuter(1), filterDeficiencyTrit(1)];
const seen = (colour) => EYES.map((eye) => eye(colour));
const apart = (one, other) => Math.min(...one.map((colour, eye) => difference(colour, other[eye])));

// The least difference (CIEDE2000) between two of `colours`, for whoever sees them least.
export function leastDifference(colours) {
  const all = colours.map((text) => seen(parse(text)));
  return Math.min(...all.flatMap((one, i) => all.slice(0, i).map((other) => apart(one, other))));
}

function candidates(ground) {
  const found = [];
  const steps = Array.from({ length: 256 / STEP + 1 }, (_, k) => (k * STEP) / 255);
  for (const r of steps) {
    for (const g of steps) {
      for (const b of steps) found.push({ mode: "rgb", r, g, b });
    }
  }
  const isFit = (colour) => {
    const contrast = wcagContrast(colour, ground);
    return contrast >= CONTRAST_LEAST && contrast <= CONTRAST_MOST && lch(colour).c >= CHROMA_LEAST;
  };
  return found.filter(isFit).map((colour) => ({ colour, seen: seen(colour) }));
}

// Each as far from all before it as it can be: the first few are the farthest apart.
function farthestFirst(all, first) {
  const chosen = [first];
  const nearest = all.map((one) => apart(one.seen, all[first].seen));
  while (chosen.length < COUNT) {
    const next = nearest.reduce((most, far, i) => (far > nearest[most] ? i : most), 0);
    chosen.push(next);
    all.forEach((one, i) => (nearest[i] = Math.min(nearest[i], apart(one.seen, all[next].seen))));
  }
  return chosen.map((i) => formatHex(all[i].colour));
}

function best(ground) {
  const all = candidates(ground);
  const palettes = Array.from({ length: STARTS }, (_, k) => farthestFirst(all, Math.floor((k * all.length) / STARTS)));
  return palettes.reduce((found, one) => (leastDifference(one) > leastDifference(found) ? one : found));
}

if (process.argv[1] === fileURLToPath(import.meta.url)) {
  const palettes = Object.fromEntries(Object.entries(GROUNDS).map(([name, ground]) => [name, best(ground)]));
  const lines = Object.entries(palettes).map(([name, colours]) => `  ${name}: ${JSON.stringify(colours).replaceAll(",", ", ")},\n`);
  await writeFile(FILE, `// Made by palette.mjs.\nexport const PALETTE = {\n${lines.join("")}};\n`);
  for (const [name, colours] of Object.entries(palettes)) {
    console.log(name, ...[8, 12, 16].map((n) => `${n}: ${leastDifference(colours.slice(0, n)).toFixed(1)}`));
  }
}
