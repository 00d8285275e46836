// Bundles a page that a program of ours serves, its script, style and HTML, into that program's package. --check: compares.
import { build } from "esbuild";
import { createHash } from "node:crypto";
import { mkdir, readFile, writeFile } from "node:fs/promises";
import { dirname, join } from "node:path";
import { fileURLToPath } from "node:url";

const here = dirname(fileURLToPath(import.meta.url));
const root = join(here, "..", "..", "..", "..");
const shared = { absWorkingDir: here, bundle: true, minify: true, legalComments: "none", write: false, logLevel: "warning", metafile: true };

// `name`: of the folder beside this file and of its files; `into`: from the checkout's root; `by`: the script that calls.
export async function bundlePage({ name, into, by }) {
  const script = await build({ ...shared, entryPoints: [`${name}/${name}.js`], format: "iife", target: "es2022" });
  const style = await build({ ...shared, entryPoints: [`${name}/${name}.css`] });
  const inputs = [script, style].flatMap(({ metafile }) => Object.keys(metafile.inputs)).filter((path) => !path.startsWith("node_modules/"));
  const digests = []; // of what is in it: without npm, a test still sees that something was not built
  for (const source of [by, "bundled.mjs", `${name}/${name}.html`, ...inputs].sort()) digests.push(`${source} ${createHash("sha256").update(await readFile(join(here, source))).digest("hex")}`);
  await put(join(root, into), {
    [`${name}.js`]: `/* ${await licences(script.metafile)}sources, sha256:\n${digests.join("\n")}\n*/\n${script.outputFiles[0].text}`,
    [`${name}.css`]: style.outputFiles[0].text,
    [`${name}.html`]: await readFile(join(here, name, `${name}.html`), "utf8"),
  }, into);
}

// Of packages that are in it, with their versions.
async function licences(metafile) {
  const packages = new Set(Object.keys(metafile.inputs).map((path) => path.match(/^node_modules\/((?:@[^/]+\/)?[^/]+)/)?.[1]).filter(Boolean));
  let text = "";
  for (const used of [...packages].sort()) {
    const folder = join(here, "node_modules", used);
    const { version } = JSON.parse(await readFile(join(folder, "package.json"), "utf8"));
    text += `With ${used} ${version}:\n${(await readFile(join(folder, "LICENSE"), "utf8")).trim()}\n\n`;
  }
  return text;
}

async function put(folder, files, shown) {
  if (!process.argv.includes("--check")) {
    await mkdir(folder, { recursive: true });
    for (const [name, text] of Object.entries(files)) await writeFile(join(folder, name), text);
    return;
  }
  const stale = [];
  for (const [name, text] of Object.entries(files)) {
    if ((await readFile(join(folder, name), "utf8").catch(() => "")) !== text) stale.push(name);
  }
  if (stale.length) {
    console.error(`${shown}: ${stale.join(", ")}: not what web/ builds to: npm ci && npm run build`);
    process.exitCode = 1;
  }
}
