// Bundles edit/, and what it takes of src/, into mission/edit/bundle/, which is part of that package. --check: compares.
import { bundlePage } from "./bundled.mjs";

await bundlePage({ name: "edit", into: "mission/edit/bundle", by: "build_edit.mjs" });
