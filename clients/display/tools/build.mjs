// Builds the page, or the tests: node build.mjs page|tests OUTPUT
import { cpSync, mkdirSync, readdirSync, rmSync, symlinkSync } from "node:fs";
import { dirname, join } from "node:path";
import { fileURLToPath } from "node:url";
import { build } from "esbuild";

const root = dirname(dirname(fileURLToPath(import.meta.url)));
const [what, output] = process.argv.slice(2);
if (!["page", "tests"].includes(what) || !output) {
  console.error("usage: node build.mjs page|tests OUTPUT");
  process.exit(2);
}
rmSync(output, { recursive: true, force: true });
mkdirSync(output, { recursive: true });

const common = { bundle: true, format: "esm", logLevel: "warning", charset: "utf8", sourcemap: true };
if (what === "page") {
  await build({ ...common, entryPoints: [join(root, "src/main.ts")], outdir: output, target: "es2022", minify: true });
  cpSync(join(root, "static"), output, { recursive: true });
} else {
  symlinkSync(join(root, "node_modules"), join(output, "node_modules")); // where Node looks for playwright-core
  for (const kind of ["unit", "browser", "bench"]) {
    const folder = join(root, kind === "bench" ? kind : `tests/${kind}`);
    if (kind === "browser") await buildPages(join(folder, "pages"));
    const entryPoints = readdirSync(folder)
      .filter((name) => name.endsWith(kind === "bench" ? ".ts" : ".test.ts"))
      .map((name) => join(folder, name));
    const options = {
      platform: "node",
      target: "node18",
      external: ["playwright-core"],
      outExtension: { ".js": ".mjs" },
    };
    await build({ ...common, ...options, entryPoints, outdir: join(output, kind) });
  }
}

// Scripts that a test puts into a page.
async function buildPages(folder) {
  const entryPoints = readdirSync(folder).map((name) => join(folder, name));
  await build({
    ...common,
    format: "iife",
    sourcemap: false,
    target: "es2022",
    entryPoints,
    outdir: join(output, "pages"),
  });
}
