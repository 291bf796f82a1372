// Glass age: from the exposure of a pose to the end of the draw that shows it, with the shares of all between, and the
// CPU time of a draw compared with that of the bare images. The real chain on this host, headless Chromium, four panels
// of 512 x 512 pixels.
//
//   node glass.mjs [--json] [--quick]
import { readdirSync, readFileSync } from "node:fs";
import { parseArgs } from "node:util";
import type { Page } from "playwright-core";
import type { App } from "../src/page/app.ts";
import type { DrawTime } from "../src/page/draw_times.ts";
import { launchServer } from "../tests/support/browser.ts";
import { until } from "../tests/support/page_probe.ts";
import { RealChain } from "../tests/support/real_chain.ts";

declare const bregma: App; // in the page

const kPanel_px = 512;
const kGap_px = 4;
const kMaxRatio = 1.5;
const kClockTick_ms = 10; // of /proc/PID/stat
const kCustusX_ms = 285; // PMC4819973

const { values: options } = parseArgs({
  options: { json: { type: "boolean" }, quick: { type: "boolean" }, help: { type: "boolean", short: "h" } },
});
if (options.help) {
  console.log("The age of poses on the glass, in headless Chromium\nUsage: bench display [--json] [--quick]");
  process.exit(0);
}

interface Figure {
  readonly name: string;
  readonly value: number;
  readonly unit: string;
  readonly limit?: number; // at most
  readonly peer?: number;
  readonly peer_name?: string;
}

let allHold = true;

// The same output as that of bench/record.hpp.
function report(figure: Figure): void {
  const { name, value, unit, limit, peer, peer_name } = figure;
  const holds = limit === undefined || value <= limit;
  allHold &&= holds;
  if (options.json) {
    const bounded = limit !== undefined;
    const line = {
      name,
      value,
      unit,
      limit: limit ?? null,
      holds: bounded ? holds : null,
      peer: peer ?? null,
      peer_name: peer_name ?? "",
    };
    console.log(JSON.stringify(line));
    return;
  }
  const number = (x: number) => String(Number(x.toPrecision(4)));
  const bound = limit === undefined ? "-" : `<= ${number(limit)}`;
  const beside = peer === undefined ? "-" : `${number(peer)} (${peer_name})`;
  const verdict = limit === undefined ? "-" : holds ? "yes" : "NO";
  console.log(
    `${name.padEnd(52)} ${number(value).padStart(12)} ${unit.padEnd(8)} ${bound.padStart(14)} ${verdict.padEnd(6)} ${beside}`,
  );
}

function percentile(values: readonly number[], p: number): number {
  const sorted = values.filter(Number.isFinite).sort((a, b) => a - b);
  return sorted.length > 0 ? sorted[Math.min(sorted.length - 1, Math.floor(p * sorted.length))] : Number.NaN;
}

// CPU time of a process and all that it started.
function cpu_ms(root: number): number {
  const parents = new Map<number, number>();
  const times = new Map<number, number>();
  for (const entry of readdirSync("/proc").filter((name) => /^\d+$/.test(name))) {
    try {
      const stat = readFileSync(`/proc/${entry}/stat`, "utf8");
      const fields = stat.slice(stat.lastIndexOf(")") + 2).split(" ");
      parents.set(Number(entry), Number(fields[1]));
      times.set(Number(entry), (Number(fields[11]) + Number(fields[12])) * kClockTick_ms);
    } catch {} // it has ended meanwhile
  }
  const belongs = (pid: number): boolean => pid === root || (pid > 1 && belongs(parents.get(pid) ?? 0));
  let sum = 0;
  for (const [pid, time] of times) if (belongs(pid)) sum += time;
  return sum;
}

interface Block {
  readonly times: DrawTime[];
  readonly draws: number;
  readonly cpu_ms: number; // per draw
}

async function block(page: Page, browser: number, bare: boolean, seconds: number): Promise<Block> {
  await page.evaluate((b) => {
    bregma.bare = b;
    bregma.changed();
  }, bare);
  await page.waitForTimeout(500);
  await page.evaluate(() => {
    bregma.times.times.length = 0;
  });
  const drawn = () => page.evaluate(() => bregma.draws);
  const first = await drawn();
  const before = cpu_ms(browser);
  await page.waitForTimeout(1000 * seconds);
  const used = cpu_ms(browser) - before;
  const draws = (await drawn()) - first;
  const times = await page.evaluate(() => bregma.times.times.slice());
  return { times, draws, cpu_ms: used / Math.max(draws, 1) };
}

async function openPage(url: string): Promise<{ page: Page; browser: number; close(): Promise<void> }> {
  const { browser, pid, close } = await launchServer();
  const page = await browser.newPage({ viewport: { width: 1600, height: 1200 } });
  await page.goto(url);
  // The picture has 2 x 512 pixels and the gap between the panels on each side.
  const side = 2 * kPanel_px + kGap_px;
  await page.evaluate((px) => {
    const { style } = bregma.display.element;
    style.flex = "none";
    style.width = style.height = `${px}px`;
  }, side);
  return { page, browser: pid, close };
}

async function measure(page: Page, browser: number): Promise<void> {
  const seconds = options.quick ? 4 : 15;
  const blocks: Record<"full" | "bare", Block[]> = { full: [], bare: [] };
  for (let i = 0; i < (options.quick ? 2 : 4); ++i) {
    blocks.bare.push(await block(page, browser, true, seconds));
    blocks.full.push(await block(page, browser, false, seconds));
  }
  const times = blocks.full.flatMap((b) => b.times).filter((t) => Number.isFinite(t.glass_age_ms));
  const of = (name: keyof DrawTime) => times.map((t) => t[name]);
  report({
    name: "glass age, exposure to drawn, p50",
    value: percentile(of("glass_age_ms"), 0.5),
    unit: "ms",
    peer: kCustusX_ms,
    peer_name: "CustusX, tip to display",
  });
  report({ name: "glass age, exposure to drawn, p99", value: percentile(of("glass_age_ms"), 0.99), unit: "ms" });
  const shares = [
    ["exposure to publication: tracker, DDS, daemon", "daemon_ms"],
    ["publication to written: DDS, gateway, the page's turn", "gateway_ms"],
    ["socket", "socket_ms"],
    ["decoding, and waiting for the browser", "wait_ms"],
    ["draw", "draw_ms"],
  ] as const;
  for (const [name, key] of shares) {
    report({ name: `share of ${name}, p50`, value: percentile(of(key), 0.5), unit: "ms" });
    report({ name: `share of ${name}, p99`, value: percentile(of(key), 0.99), unit: "ms" });
  }
  const total_s = seconds * blocks.full.length;
  report({ name: "draws", value: blocks.full.reduce((sum, b) => sum + b.draws, 0) / total_s, unit: "Hz" });
  const mean = (all: Block[]) => all.reduce((sum, b) => sum + b.cpu_ms, 0) / all.length;
  const bare = mean(blocks.bare);
  report({
    name: "CPU of a draw, all processes of the browser",
    value: mean(blocks.full),
    unit: "ms",
    limit: kMaxRatio * bare,
    peer: bare,
    peer_name: "bare textured panels",
  });
}

const build = process.env.BREGMA_BUILD;
const chain = new RealChain({
  bin: `${build}/bin`,
  page: `${build}/display`,
  caseFolder: process.env.BREGMA_CASE ?? "out/cases/colin27",
  domain: Number(process.env.BREGMA_DOMAIN ?? 77),
});
let close = async () => {};
try {
  const url = await chain.start();
  const opened = await openPage(url);
  close = opened.close;
  console.error("bench display: the operation is brought to navigation");
  await until(
    () => opened.page.evaluate(() => bregma.scene?.tools.some((t) => t.verified) ?? false),
    (live) => live,
    "a live pose",
    300_000,
  );
  await opened.page.waitForTimeout(2000);
  await measure(opened.page, opened.browser);
} catch (error) {
  console.error(`bench display: ${(error as Error).message}`);
  process.exitCode = 2;
} finally {
  await close();
  await chain.stop();
}
if (process.exitCode === undefined && !allHold) process.exitCode = 1;
