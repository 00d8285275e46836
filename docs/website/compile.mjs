// Compiles a folder of Python sources with the interpreter of the page, and writes them with their bytecode as one zip:
// node compile.mjs PYODIDE FOLDER ZIP
import { readFileSync, readdirSync, writeFileSync } from "node:fs";
import { join, resolve } from "node:path";
import { pathToFileURL } from "node:url";

const [pyodide, folder, zip] = process.argv.slice(2).map((name) => resolve(name));
const { loadPyodide } = await import(pathToFileURL(join(pyodide, "pyodide.mjs")).href);
const python = await loadPyodide({ indexURL: `${pyodide}/` });
const made = new Set();
for (const entry of readdirSync(folder, { recursive: true, withFileTypes: true })) {
  if (!entry.isFile()) continue;
  const to = `/sources${entry.parentPath.slice(folder.length)}`;
  if (!made.has(to)) python.FS.mkdirTree(to);
  made.add(to);
  python.FS.writeFile(`${to}/${entry.name}`, new Uint8Array(readFileSync(join(entry.parentPath, entry.name))));
}
python.runPython(`
import compileall, py_compile, zipfile
from pathlib import Path

# Not compared with its source's time, which unpacking changes
if not compileall.compile_dir("/sources", quiet=1, invalidation_mode=py_compile.PycInvalidationMode.UNCHECKED_HASH):
    raise SystemExit("cannot be compiled")
with zipfile.ZipFile("/made.zip", "w", zipfile.ZIP_DEFLATED) as made:
    for file in sorted(Path("/sources").rglob("*")):
        if file.is_file():
            name = zipfile.ZipInfo(str(file.relative_to("/sources")), (1980, 1, 1, 0, 0, 0))
            made.writestr(name, file.read_bytes(), zipfile.ZIP_DEFLATED)
`);
writeFileSync(zip, python.FS.readFile("/made.zip"));
