// Bundles watch/, and what it takes of src/, into companion/watch/bundle/, which is part of that package. --check: compares.
import { build } from "esbuild";
import { createHash } from "node:crypto";
import { mkdir, readFile, writeFile } from "node:fs/promises";
import { dirname, join } from "node:path";
import { fileURLToPath } from "node:url";

const here = dirname(fileURLToPath(import.meta.url));
const out = join(here, "..", "..", "..", "..", "companion", "watch", "bundle");
const shared = { absWorkingDir: here, bundle: true, minify: true, legalComments: "none", write: false, logLevel: "warning" };

const script = await build({ ...shared, entryPoints: ["watch/watch.js"], format: "iife", target: "es2022", metafile: true });
const style = await build({ ...shared, entryPoints: ["watch/watch.css"] });
const inputs = Object.keys(Object.values(script.metafile.outputs)[0].inputs);
const sources = ["build_watch.mjs", "watch/watch.css", "watch/watch.html", ...inputs.filter((name) => !name.startsWith("node_modules/"))].sort();
const digests = []; // of what is in it: without npm, a test still sees that something was not built
for (const name of sources) digests.push(`${name} ${createHash("sha256").update(await readFile(join(here, name))).digest("hex")}`);
const noble = join(here, "node_modules", "@noble", "hashes");
const { version } = JSON.parse(await readFile(join(noble, "package.json"), "utf8"));
const licence = (await readFile(join(noble, "LICENSE"), "utf8")).trim();
const files = {
  "watch.js": `/* With @noble/hashes ${version}:\n${licence}\n\nsources, sha256:\n${digests.join("\n")}\n*/\n${script.outputFiles[0].text}`,
  "watch.css": style.outputFiles[0].text,
  "watch.html": await readFile(join(here, "watch", "watch.html"), "utf8"),
};
if (process.argv.includes("--check")) {
  const stale = [];
  for (const [name, text] of Object.entries(files)) {
    if ((await readFile(join(out, name), "utf8").catch(() => "")) !== text) stale.push(name);
  }
  if (stale.length) {
    console.error(`companion/watch/bundle: ${stale.join(", ")}: not what web/ builds to: npm ci && npm run build`);
    process.exit(1);
  }
} else {
  await mkdir(out, { recursive: true });
  for (const [name, text] of Object.entries(files)) await writeFile(join(out, name), text);
}
