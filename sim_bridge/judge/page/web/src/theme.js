// Light and dark: what canvases need of the style sheet, and a colour for each vehicle.
const LIGHT = ["#332288", "#c14e63", "#117733", "#2b87b5", "#aa4499", "#7d7d17", "#1f8a78", "#882255", "#a07d12"];
const DARK = ["#a5a0ff", "#f08a9b", "#55c47f", "#88ccee", "#e08ad4", "#d2d25a", "#5fd3c0", "#ec7fb0", "#ead27a"];
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

// Told apart at a glance if they are few, in order along a ramp if many.
export function vehicleColour(index, count) {
  const few = isDark() ? DARK : LIGHT;
  if (count <= few.length) return few[index];
  const hue = 250 + (220 * index) / (count - 1);
  return `hsl(${hue % 360} 60% ${isDark() ? 70 : 38}%)`;
}
