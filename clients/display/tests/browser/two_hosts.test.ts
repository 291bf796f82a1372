// A display on a host of its own, without a shared folder: its page is that of the daemon's host, pixel for pixel.
import assert from "node:assert/strict";
import { type ChildProcess, spawn } from "node:child_process";
import { chmodSync, mkdirSync, mkdtempSync, readdirSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { after, before, test } from "node:test";
import type { Browser, Page } from "playwright-core";
import type { App } from "../../src/page/app.ts";
import { launchBrowser } from "../support/browser.ts";
import { headCase } from "../support/head_case.ts";
import { untilTool } from "../support/page_probe.ts";

declare const bregma: App; // in the page

const build = process.env.BREGMA_BUILD as string;
const kCannotMakeHosts = 77;

let hosts: ChildProcess;
let folder = "";
let skipped = "";
const browsers: Browser[] = [];
const pages: Page[] = [];

// The addresses and processes of both gateways, or why there are no hosts.
function startHosts(): Promise<[number, string][]> {
  const head = headCase(build, process.env.BREGMA_SOURCE as string);
  hosts = spawn(`${build}/bin/display_two_hosts`, [`${build}/bin`, `${build}/display`, head, folder]);
  return new Promise((resolve, reject) => {
    let [out, error] = ["", ""];
    hosts.stdout?.on("data", (data) => {
      out += data;
      const lines = out.split("\n").slice(0, -1);
      if (lines.length === 2)
        resolve(lines.map((line) => [Number(line.split(" ")[0]), line.split(" ")[1]] as [number, string]));
    });
    hosts.stderr?.on("data", (data) => {
      error += data;
    });
    hosts.on("exit", (code) => {
      if (code === kCannotMakeHosts) skipped = error.trim();
      if (skipped) resolve([]);
      else reject(new Error(error));
    });
  });
}

// A browser on the host of this process.
async function openOn(pid: number, url: string): Promise<void> {
  const program = join(folder, `browser${pid}`);
  writeFileSync(program, `#!/bin/sh\nexec nsenter --net=/proc/${pid}/ns/net -- /usr/bin/chromium "$@"\n`);
  chmodSync(program, 0o755);
  const browser = await launchBrowser(program);
  browsers.push(browser);
  const page = await browser.newPage({ viewport: { width: 1000, height: 640 } });
  pages.push(page);
  await page.goto(url);
}

before(async () => {
  folder = mkdtempSync(join(tmpdir(), "bregma-hosts-"));
  for (const [pid, url] of await startHosts()) await openOn(pid, url);
});

after(async () => {
  for (const browser of browsers) await browser.close();
  if (hosts && hosts.exitCode === null) {
    await new Promise((resolve) => {
      hosts.on("exit", resolve);
      hosts.stdin?.end();
    });
  }
  rmSync(folder, { recursive: true, force: true });
});

// The page draws the states that it has for one moment, 40 ms after the exposure of the pose, and takes no others.
async function freeze(page: Page): Promise<void> {
  await page.evaluate(() => {
    const app = bregma as unknown as { take: () => void; watch: () => void; showCover: () => boolean };
    const moment = (bregma.store.get("tool", "Probe")?.acquired_ms ?? Number.NaN) + 40;
    app.take = () => {};
    app.watch = () => {};
    app.showCover = () => false;
    bregma.link.clock.at = () => moment;
    Date.prototype.toLocaleTimeString = () => "12:00:00";
    for (const time of document.querySelectorAll("time")) time.textContent = "12:00:00";
    bregma.changed();
  });
  await page.evaluate(
    () => new Promise((resolve) => requestAnimationFrame(() => requestAnimationFrame(() => setTimeout(resolve, 300)))),
  );
}

const differing = (a: Buffer, b: Buffer): Promise<number> =>
  pages[0].evaluate(
    async ([one, other]) => {
      const pixels = async (png: string) => {
        const image = new Image();
        image.src = `data:image/png;base64,${png}`;
        await image.decode();
        const canvas = document.createElement("canvas");
        [canvas.width, canvas.height] = [image.width, image.height];
        const c = canvas.getContext("2d")!;
        c.drawImage(image, 0, 0);
        return c.getImageData(0, 0, image.width, image.height).data;
      };
      const [p, q] = [await pixels(one), await pixels(other)];
      if (p.length !== q.length) return -1;
      return p.reduce((count, value, i) => count + (value !== q[i] ? 1 : 0), 0);
    },
    [a.toString("base64"), b.toString("base64")] as const,
  );

test("the page on the other host is that of the daemon's host, pixel for pixel", async (context) => {
  if (skipped) return context.skip(skipped);
  for (const page of pages) await untilTool(page);
  const data = await pages[1].evaluate(async () => (await fetch("/case")).json());
  assert.ok(data.labels.regions.length > 100, "with the labels of the case");
  for (const page of pages) {
    await page.getByRole("button", { name: "Labels" }).click();
    await page.evaluate(() => {
      bregma.view.setCursor([5, 10, 15]);
    });
    await freeze(page);
  }
  const shots = [await pages[0].screenshot(), await pages[1].screenshot()];
  const screenshots = `${build}/display_tests/screenshots`;
  mkdirSync(screenshots, { recursive: true });
  shots.forEach((shot, i) => {
    writeFileSync(`${screenshots}/host_${i}.png`, shot);
  });
  const shown = await Promise.all(pages.map((page) => page.evaluate(() => bregma.scene?.tools.length ?? 0)));
  assert.deepEqual(shown, [2, 2]);
  assert.equal(await differing(shots[0], shots[1]), 0);

  // The comparison sees a plane that lies elsewhere.
  await pages[1].evaluate(() => {
    bregma.view.setCursor([5, 10, 16]);
    bregma.changed();
  });
  await pages[1].evaluate(() => new Promise((resolve) => setTimeout(resolve, 500)));
  assert.ok((await differing(shots[0], await pages[1].screenshot())) > 1000);
});

test("each gateway has its own copy of the case", async (context) => {
  if (skipped) return context.skip(skipped);
  const [first, second] = ["host0", "host1"].map((host) => readdirSync(join(folder, host)).sort());
  assert.ok(first.length > 5);
  assert.deepEqual(first, second);
  for (const name of first) {
    const contents = ["host0", "host1"].map((host) => readFileSync(join(folder, host, name)));
    assert.ok(contents[0].equals(contents[1]), name);
  }
});
