// The display on the whole screen: Chromium with the arguments of the unit that is shipped.
import assert from "node:assert/strict";
import { mkdtempSync, readFileSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { after, before, test } from "node:test";
import type { BrowserContext, Page } from "playwright-core";
import { launchWithProfile } from "../support/browser.ts";
import { FakeGateway, insertion } from "../support/fake_gateway.ts";
import { toolsShown, until, untilTool } from "../support/page_probe.ts";

const unit = readFileSync(`${process.env.BREGMA_SOURCE}/deploy/bregma-kiosk.service`, "utf8");
const words = (/^ExecStart=((?:.*\\\n)*.*)$/m.exec(unit)?.[1] ?? "").replaceAll("\\\n", " ").split(/\s+/);

const gateway = new FakeGateway(`${process.env.BREGMA_BUILD}/display`);
let profile = "";
let context: BrowserContext;
let page: Page;

// Not given: the screen, which a test has not, and what is told to the browser in another way.
const kElsewhere = ["--kiosk", "--ozone-platform", "--user-data-dir"];

before(async () => {
  gateway.tool = (now) => ({ ...insertion(now, 0.5), valid_until_ms: now + 290 });
  const url = await gateway.start();
  profile = mkdtempSync(join(tmpdir(), "bregma-kiosk-"));
  const flags = words.filter((word) => word.startsWith("--") && word !== "--");
  context = await launchWithProfile(
    profile,
    flags.filter((flag) => !kElsewhere.includes(flag.split("=")[0])),
  );
  page = context.pages()[0] ?? (await context.newPage());
  await page.goto(url);
});

after(async () => {
  await context?.close();
  await gateway.stop();
  rmSync(profile, { recursive: true, force: true });
});

test("the unit opens the gateway's page on the whole screen, with a new profile", () => {
  assert.deepEqual(words.slice(0, 3), ["/usr/bin/cage", "--", "/usr/bin/chromium"]);
  assert.ok(words.includes("--kiosk"));
  assert.ok(words.some((word) => word.startsWith("--user-data-dir=") && word.includes("RUNTIME_DIRECTORY")));
  assert.equal(words.at(-1), "http://localhost:8310/");
  const gatewayUnit = readFileSync(`${process.env.BREGMA_SOURCE}/deploy/bregma-gateway.service`, "utf8");
  assert.doesNotMatch(gatewayUnit, /--port/); // its default is the unit's
});

test("its browser draws the page, and sound needs no click", async () => {
  await untilTool(page);
  const ready = () =>
    page.evaluate(() => document.querySelector('[aria-label="Sound"]')?.classList.contains("on") ?? false);
  await until(ready, (on) => on, "sound without a click");
});

test("a browser that cannot draw says so, instead of a dark screen", async () => {
  const other = await context.newPage();
  await other.addInitScript(() => {
    HTMLCanvasElement.prototype.getContext = () => null;
  });
  await other.goto(page.url());
  const text = await other.locator(".cover").textContent();
  assert.match(
    text ?? "",
    /^This browser cannot draw\s*It has no WebGL 2: no graphics card, or a driver that it does not trust\.$/,
  );
  await other.close();
});

test("a browser that was faster than its gateway loads the page when that is there", async () => {
  const { port } = new URL(page.url());
  await gateway.stop();
  await page.goto(`http://127.0.0.1:${port}/`).catch(() => {}); // refused
  const tools = () => toolsShown(page).catch(() => -1); // no page yet, or it is being loaded
  assert.equal(await tools(), -1);
  await gateway.start(Number(port));
  await until(tools, (n) => n > 0, "the page, without a reload by hand");
});
