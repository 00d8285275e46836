// What the pages' sources are held to: real defects, dead code, one idea a file, and functions that fit a head.
import js from "@eslint/js";
import globals from "globals";

const rules = {
  complexity: ["error", 12],
  "max-lines": ["error", { max: 400 }],
  "max-depth": ["error", 4],
  "max-params": ["error", 6],
  eqeqeq: "error",
  curly: ["error", "multi-line"],
  "no-var": "error",
  "prefer-const": ["error", { destructuring: "all" }],
  "no-unused-vars": ["error", { argsIgnorePattern: "^_", varsIgnorePattern: "^_" }],
  "no-shadow": "error",
  "no-eval": "error",
  "no-implied-eval": "error",
  "no-implicit-globals": "error",
  "no-implicit-coercion": "error",
  "no-param-reassign": "error",
  "no-return-assign": ["error", "except-parens"],
  "no-self-compare": "error",
  "no-throw-literal": "error",
  "no-unmodified-loop-condition": "error",
  "no-unreachable-loop": "error",
  "no-useless-return": "error",
  "no-useless-rename": "error",
  "no-useless-concat": "error",
  "no-template-curly-in-string": "error",
  "no-duplicate-imports": "error",
  "no-promise-executor-return": "error",
  "no-console": "error",
  "array-callback-return": "error",
  "consistent-return": "error",
  "default-case-last": "error",
  "dot-notation": "error",
  "object-shorthand": "error",
  "prefer-template": "error",
  "require-atomic-updates": "error",
};

// A page asks nothing of a network but its own stream (and sends orders, in one file), and writes no HTML from text.
const page = {
  "no-restricted-globals": ["error", "fetch", "XMLHttpRequest", "event", "name"],
  "no-restricted-properties": ["error", { property: "innerHTML" }, { property: "outerHTML" }, { object: "document", property: "write" }],
};

const shared = { ecmaVersion: 2022, sourceType: "module" };

export default [
  js.configs.recommended,
  { linterOptions: { reportUnusedDisableDirectives: "error" } },
  { files: ["src/**/*.js", "watch/**/*.js", "edit/**/*.js"], languageOptions: { ...shared, globals: globals.browser }, rules: { ...rules, ...page } },
  { files: ["edit/client.js"], rules: { "no-restricted-globals": ["error", "XMLHttpRequest", "event", "name"] } }, // it asks its server for what a reader does
  { files: ["watch/orders/send.js"], rules: { "no-restricted-globals": ["error", "XMLHttpRequest", "event", "name"] } },
  { files: ["*.mjs", "test/**/*.mjs"], languageOptions: { ...shared, globals: { ...globals.node, ...globals.es2024 } }, rules: { ...rules, "no-console": "off" } },
];
