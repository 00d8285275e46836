// Bundles watch/, and what it takes of src/, into companion/watch/bundle/, which is part of that package. --check: compares.
import { bundlePage } from "./bundled.mjs";

await bundlePage({ name: "watch", into: "companion/watch/bundle", by: "build_watch.mjs" });
