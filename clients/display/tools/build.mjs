// Builds the page, or the tests: node build.mjs page|tests OUTPUT
import { cpSync, mkdirSync, readdirSync, rmSync } from "node:fs";
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
  for (const kind of ["unit", "browser"]) {
    const folder = join(root, "tests", kind);
    const entryPoints = readdirSync(folder)
      .filter((name) => name.endsWith(".test.ts"))
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
