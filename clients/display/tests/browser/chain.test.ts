// The page on the real chain: bregmad, the simulated operating room, the case server and bregma-gateway as processes. The
// operation goes on from a registration; then each of them stops, or is killed.
import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { mkdirSync, readdirSync } from "node:fs";
import { after, before, type TestContext, test } from "node:test";
import type { Browser, Page } from "playwright-core";
import type { App } from "../../src/page/app.ts";
import { kColours } from "../../src/view/colours.ts";
import { launchBrowser } from "../support/browser.ts";
import { assertBackInTime, assertGoneInTime, startLog, takeLog } from "../support/glass_log.ts";
import { headCase } from "../support/head_case.ts";
import { countColour, coverTitle, textOf, toolsShown, until } from "../support/page_probe.ts";
import { RealChain } from "../support/real_chain.ts";
import { ReferenceClient } from "../support/reference_client.ts";

declare const bregma: App; // in the page

const build = process.env.BREGMA_BUILD ?? "";
const shots = `${build}/display_tests/screenshots`;
const caseFolder = headCase(build, process.env.BREGMA_SOURCE ?? "");
let chain: RealChain;
let browser: Browser;
let page: Page;
let reference: ReferenceClient;
const errors: string[] = [];

before(async () => {
  mkdirSync(shots, { recursive: true });
  chain = new RealChain({
    bin: `${build}/bin`,
    page: `${build}/display`,
    caseFolder,
    domain: Number(process.env.BREGMA_DOMAIN ?? 40 + (process.pid % 150)),
  });
  const url = await chain.start();
  browser = await launchBrowser();
  page = await browser.newPage({ viewport: { width: 1000, height: 640 } });
  page.on("pageerror", (e) => errors.push(e.message));
  await page.goto(url);
  reference = new ReferenceClient(Number(new URL(url).port));
});
after(async () => {
  reference?.stop();
  await browser?.close();
  await chain?.stop();
});

const session = () => textOf(page, ".session");
const untilSession = (wanted: RegExp, limit_ms: number) =>
  until(session, (s) => wanted.test(s), `session ${wanted}`, limit_ms);
// A busy machine can lose the simulated tracker for a moment: then the operator begins again.
async function navigating(): Promise<boolean> {
  if (!chain.running("bregma-sim-room")) chain.startRoom();
  return /Navigating/.test(await session());
}
const untilVerified = () =>
  until(
    () => page.evaluate(() => bregma.scene?.tools.some((t) => t.verified) ?? false),
    (live) => live,
    "a live pose",
    60_000,
  );
const untilGone = () =>
  until(
    () => toolsShown(page),
    (n) => n === 0,
    "no tool is shown",
  );

async function noProbe(): Promise<void> {
  for (const colour of [kColours.live, kColours.unverified]) {
    assert.equal(await countColour(page, "overlay", colour), 0);
    assert.equal(await countColour(page, "picture", colour), 0);
  }
}

test("the case arrives over DDS, and the operation is followed to navigation", async () => {
  await untilPictureWithin(120_000);
  assert.equal(await textOf(page, ".case-id"), "colin27");
  await until(navigating, (n) => n, "navigation", 180_000);
  await untilVerified();
  const reports = await page.evaluate(() => bregma.store.all("fiducial").map((f) => f.norm_mm));
  assert.equal(reports.length, 8);
  for (const norm of reports) assert.ok(norm < 5);
  assert.ok((await page.evaluate(() => bregma.scene?.captures.length ?? 0)) > 30);
  await page.screenshot({ path: `${shots}/chain_navigating.png` });
  await startLog(page);
});

const untilPictureWithin = (limit_ms: number) =>
  until(
    () => coverTitle(page),
    (t) => t === "",
    "the picture",
    limit_ms,
  );

// Something stops: the probe must be gone from all panels within its limit and one draw, and the reason be stated. It
// goes on: the picture must be back, without a reload, within a second of the first valid state.
interface Interruption {
  readonly stop: () => void | Promise<void>;
  readonly cover: RegExp;
  readonly lasts_ms?: number; // beyond the cover
  readonly resume: () => void | Promise<void>;
  readonly back: "live" | "unverified";
  readonly shot: string;
}

async function interrupted(
  t: TestContext,
  { stop, cover, resume, back, shot, lasts_ms = 0 }: Interruption,
): Promise<void> {
  await untilVerified();
  await takeLog(page);
  await stop();
  await untilGone();
  await until(
    () => coverTitle(page),
    (title) => cover.test(title),
    "the cover",
  );
  await noProbe();
  await page.screenshot({ path: `${shots}/chain_${shot}.png` });
  const over_ms = assertGoneInTime(await takeLog(page));
  await new Promise((resolve) => setTimeout(resolve, lasts_ms));
  const resumed_ms = Date.now();
  await resume();
  await backWith(back).catch((error: Error) => {
    throw new Error(`${error.message}; bregmad: ${chain.log("bregmad").split("\n").slice(-12).join("\n")}`);
  });
  const valid_ms = await until(
    async () => reference.firstDrawable(resumed_ms),
    (at) => !Number.isNaN(at), // the page can be the first of the two to be connected again
    "a drawable pose at the second client",
  );
  const log = await takeLog(page);
  assertGoneInTime(log);
  const took_ms = assertBackInTime(log, resumed_ms, valid_ms);
  t.diagnostic(
    `gone ${over_ms.toFixed(0)} ms after its limit, back ${took_ms} ms after the first valid state; longest draw ${log.draw_ms.toFixed(0)} ms, longest pause ${log.pause_ms} ms`,
  );
}

// What is drawn after an interruption must have been exposed after it.
async function backWith(status: "live" | "unverified"): Promise<void> {
  await untilPictureWithin(60_000); // a daemon that starts reads its case first
  const verified = () => page.evaluate(() => bregma.scene?.tools.map((t) => t.verified) ?? []);
  await until(verified, (v) => v.length > 0, "a tool", 60_000);
  if (status === "unverified") assert.ok((await verified()).every((v) => !v));
  const age = await page.evaluate(() => Math.max(0, ...(bregma.scene?.tools.map((t) => t.shown.age_ms) ?? [])));
  assert.ok(age < 300, `${age} ms`);
}

test("a stopped daemon", (t) =>
  interrupted(t, {
    stop: () => chain.signal("bregmad", "SIGSTOP"),
    cover: /silent|No navigation state/,
    resume: () => chain.signal("bregmad", "SIGCONT"),
    back: "live",
    shot: "daemon_stopped",
  }));

test("a stopped gateway", (t) =>
  interrupted(t, {
    stop: () => chain.signal("bregma-gateway", "SIGSTOP"),
    cover: /^Connection lost$/,
    resume: () => chain.signal("bregma-gateway", "SIGCONT"),
    back: "live",
    shot: "gateway_stopped",
  }));

test("a gateway that is killed, with its sockets, and started again", (t) =>
  interrupted(t, {
    stop: () => chain.signal("bregma-gateway", "SIGKILL"),
    cover: /^Connection lost$/,
    resume: () => chain.startGateway(),
    back: "live",
    shot: "gateway_killed",
  }));

test("a page that is hidden for ten seconds", (t) => {
  const hide = (hidden: boolean) =>
    page.evaluate((h) => {
      Object.defineProperty(document, "hidden", { value: h, configurable: true });
      document.dispatchEvent(new Event("visibilitychange"));
    }, hidden);
  return interrupted(t, {
    stop: () => hide(true),
    cover: /^Page in the background$/,
    lasts_ms: 10_000,
    resume: () => hide(false),
    back: "live",
    shot: "hidden",
  });
});

test("a graphics context that is lost", (t) =>
  interrupted(t, {
    stop: () =>
      page.evaluate(() => {
        (globalThis as unknown as { lost: { restore(): void } }).lost = bregma.display.loseContext();
      }),
    cover: /^Graphics interrupted$/,
    resume: () => page.evaluate(() => (globalThis as unknown as { lost: { restore(): void } }).lost.restore()),
    back: "live",
    shot: "context_lost",
  }));

test("a daemon that is killed and started again: the probe is back, not verified", async (t) => {
  await interrupted(t, {
    stop: () => chain.signal("bregmad", "SIGKILL"),
    cover: /./,
    resume: async () => {
      await chain.ended("bregmad");
      chain.startDaemon();
    },
    back: "unverified",
    shot: "daemon_killed",
  });
  await untilSession(/not verified/, 30_000);
  await page.screenshot({ path: `${shots}/chain_unverified.png` });
});

// A4 at 96 dots per inch, without the margins of the report's style sheet.
const kPaper = { width: 703, height: 1032 };

test("the report of the session on paper: no column is cut off, no page is half empty", async () => {
  const sessions = `${caseFolder}/sessions`;
  const files = readdirSync(sessions).filter((name) => name.endsWith(".db"));
  const navigated = files.sort().at(-2); // the last one is that of the daemon that was started again
  const report = `${shots}/report.html`;
  execFileSync(`${build}/bin/bregma`, ["report", `${sessions}/${navigated}`, "--html", report]);
  const paper = await browser.newPage({ viewport: kPaper });
  await paper.emulateMedia({ media: "print" });
  await paper.goto(`file://${report}`);
  const wide = await paper.evaluate(() =>
    [...document.querySelectorAll<HTMLElement>("section, table, th, td, figure, img")]
      .filter((e) => e.getBoundingClientRect().right > innerWidth + 1 || e.scrollWidth > e.clientWidth + 1)
      .map((e) => `${e.tagName} ${e.textContent?.slice(0, 40)}`),
  );
  assert.deepEqual(wide, []);
  const height = await paper.evaluate(() => document.documentElement.scrollHeight);
  const pdf = await paper.pdf({ path: `${shots}/report.pdf`, preferCSSPageSize: true, printBackground: true });
  const pages = pdf.toString("latin1").match(/\/Type\s*\/Page\b(?!s)/g)?.length ?? 0;
  assert.ok(pages >= 2, `${pages} pages`);
  assert.ok(height / kPaper.height >= 0.75 * (pages - 1), `${height} px on ${pages} pages`);
  await paper.close();
});

test("nothing failed in the page", () => assert.deepEqual(errors, []));
