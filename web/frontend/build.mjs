// Bundles the dashboard into web/static: hashed names, so that the server may let browsers cache them for ever.
import { readFile, writeFile, rm, mkdir } from "node:fs/promises";
import { basename, dirname, join } from "node:path";
import { fileURLToPath } from "node:url";
import { build } from "esbuild";

const here = dirname(fileURLToPath(import.meta.url));
const out = join(here, "..", "static");

await rm(out, { recursive: true, force: true });
await mkdir(out, { recursive: true });

const result = await build({
  absWorkingDir: here,
  entryPoints: { app: "src/main.tsx", theme: "src/theme_boot.ts", keeper: "src/keeper.ts" },
  bundle: true,
  minify: true,
  sourcemap: "linked",
  format: "iife",
  target: ["es2022"],
  jsx: "automatic",
  jsxImportSource: "preact",
  loader: { ".woff2": "file" },
  entryNames: "[name]-[hash]",
  assetNames: "[name]-[hash]",
  publicPath: "/static/",
  outdir: out,
  metafile: true,
  logLevel: "warning",
});

const names = { APP_JS: "", APP_CSS: "", THEME_JS: "", KEEPER_JS: "" };
for (const [path, output] of Object.entries(result.metafile.outputs)) {
  if (output.entryPoint === "src/main.tsx") {
    names.APP_JS = basename(path);
    names.APP_CSS = basename(output.cssBundle);
  }
  if (output.entryPoint === "src/theme_boot.ts") names.THEME_JS = basename(path);
  if (output.entryPoint === "src/keeper.ts") names.KEEPER_JS = basename(path);
}

let page = await readFile(join(here, "index.html"), "utf8");
for (const [key, name] of Object.entries(names)) {
  if (!name) throw new Error(`build made no ${key}`);
  page = page.replaceAll(`%${key}%`, `/static/${name}`);
}
await writeFile(join(out, "index.html"), page);

const bytes = Object.entries(result.metafile.outputs).map(([path, output]) => [basename(path), output.bytes]);
const total = bytes.filter(([name]) => !name.endsWith(".map")).reduce((sum, [, size]) => sum + size, 0);
console.log(`dashboard: ${bytes.length + 1} files, ${(total / 1024).toFixed(0)} kB`);
