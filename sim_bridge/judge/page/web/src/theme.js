// Light and dark: what canvases need of the style sheet, and a colour for each vehicle.
import { PALETTE } from "./palette.js";

const KEY = "understory-theme";
let cached = null;
let dark = null; // asked for each vehicle in each frame

function stored() {
  try {
    return localStorage.getItem(KEY);
  } catch {
    return null; // a file's storage may be closed
  }
}

function isDark() {
  const chosen = document.documentElement.dataset.theme;
  dark ??= chosen ? chosen === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
  return dark;
}

export function setUp(changed) {
  const chosen = stored();
  if (chosen === "dark" || chosen === "light") document.documentElement.dataset.theme = chosen;
  const told = () => {
    cached = dark = null;
    changed();
  };
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", told);
  return () => {
    const next = isDark() ? "light" : "dark";
    document.documentElement.dataset.theme = next;
    try {
      localStorage.setItem(KEY, next);
    } catch {
      // only this page then
    }
    told();
  };
}

// Colours by name, as the style sheet has them now.
export function colours() {
  if (!cached) {
    const style = getComputedStyle(document.documentElement);
    cached = new Proxy({}, { get: (known, name) => (known[name] ??= style.getPropertyValue(`--${name}`).trim()) });
  }
  return cached;
}

// Of the vehicle at an index: told apart by whoever looks; of more than there are colours, they come again, and the ids tell.
export function vehicleColour(index) {
  const palette = isDark() ? PALETTE.dark : PALETTE.light;
  return palette[index % palette.length];
}

// Of a text on "#rrggbb": the one of black and white that is read better there.
export function textOn(colour) {
  const [red, green, blue] = [1, 3, 5].map((at) => (parseInt(colour.slice(at, at + 2), 16) / 255) ** 2.2);
  return 0.2126 * red + 0.7152 * green + 0.0722 * blue > 0.18 ? "#000000" : "#ffffff";
}
