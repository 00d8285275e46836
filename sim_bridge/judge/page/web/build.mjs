// Bundles src/ and its libraries into ../bundle/, which is part of the package. --check: compares instead of writing.
import { build } from "esbuild";
import { createHash } from "node:crypto";
import { mkdir, readFile, readdir, writeFile } from "node:fs/promises";
import { dirname, extname, join } from "node:path";
import { fileURLToPath } from "node:url";
import { PALETTE } from "./src/palette.js";

const here = dirname(fileURLToPath(import.meta.url));
const out = join(here, "..", "bundle");
const shared = { absWorkingDir: here, bundle: true, minify: true, legalComments: "none", write: false, logLevel: "warning" };

const script = await build({ ...shared, entryPoints: ["src/main.js"], format: "iife", target: "es2022" });
const style = await build({ ...shared, entryPoints: ["src/page.css"] });
// Of every source: without npm, a test still sees that something was not built.
const sources = ["build.mjs", "package.json", "package-lock.json", ...(await readdir(join(here, "src"), { recursive: true })).filter((name) => extname(name)).sort().map((name) => `src/${name}`)];
const digest = createHash("sha256");
for (const name of sources) digest.update(`${name}\n`).update(await readFile(join(here, name)));
const licences = await Promise.all(
  ["three", "uplot"].map(async (name) => {
    const at = join(here, "node_modules", name);
    const { version } = JSON.parse(await readFile(join(at, "package.json"), "utf8"));
    return `${name} ${version}\n\n${(await readFile(join(at, "LICENSE"), "utf8")).trim()}\n`;
  }),
);
const notice = licences.join(`\n${"-".repeat(80)}\n\n`);
const files = {
  "page.js": `/* With three.js and uPlot, MIT licence: see LICENSES.txt beside this file in the package.\n${notice
    .replaceAll("*/", "* /")
    .trim()}\n\nsources: sha256 ${digest.digest("hex")} */\n${script.outputFiles[0].text}`,
  "page.css": style.outputFiles[0].text,
  "LICENSES.txt": notice,
  "palette.json": `${JSON.stringify(PALETTE)}\n`, // for plots
};

if (process.argv.includes("--check")) {
  const stale = [];
  for (const [name, text] of Object.entries(files)) {
    if ((await readFile(join(out, name), "utf8").catch(() => "")) !== text) stale.push(name);
  }
  if (stale.length) {
    console.error(`bundle/${stale.join(", bundle/")}: not what web/ builds to: npm ci && npm run build`);
    process.exit(1);
  }
} else {
  await mkdir(out, { recursive: true });
  for (const [name, text] of Object.entries(files)) await writeFile(join(out, name), text);
}
