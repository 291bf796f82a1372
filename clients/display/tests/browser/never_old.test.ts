// Nothing old is shown: whatever stops, the probe disappears, the page states why, and comes back by itself.
import assert from "node:assert/strict";
import { mkdirSync } from "node:fs";
import { after, before, test } from "node:test";
import type { App } from "../../src/page/app.ts";
import { kColours } from "../../src/view/colours.ts";
import { insertion } from "../support/fake_gateway.ts";
import {
  countColour,
  drawn,
  type OpenPage,
  openPage,
  textOf,
  toolsShown,
  until,
  untilCover,
  untilPicture,
  untilTool,
} from "../support/page_probe.ts";

declare const bregma: App; // in the page

let open: OpenPage;
const shots = `${process.env.BREGMA_BUILD}/display_tests/screenshots`;

// As long as a pose can be valid: a test machine may be slow.
const lasting = (now: number) => ({ ...insertion(now), valid_until_ms: now + 290 });

before(async () => {
  mkdirSync(shots, { recursive: true });
  open = await openPage((gateway) => {
    gateway.tool = lasting;
  });
  await untilTool(open.page);
});
after(() => open?.close());

const untilNoTool = () =>
  until(
    () => toolsShown(open.page),
    (n) => n === 0,
    "no tool is shown",
  );

const untilStatus = (text: RegExp) =>
  until(
    () => textOf(open.page, ".tool-status"),
    (t) => text.test(t),
    `status ${text}`,
  );

async function noProbeInThePicture(): Promise<void> {
  for (const colour of [kColours.live, kColours.unverified]) {
    assert.equal(await countColour(open.page, "overlay", colour), 0);
    assert.equal(await countColour(open.page, "picture", colour), 0);
  }
}

// The page writes down when what was seen, so that the test's own delays do not count.
async function watch(): Promise<void> {
  await open.page.evaluate(() => {
    const log: [number, number, string, number][] = [];
    const look = () => {
      const owed = bregma.link.owedSince?.timer_ms ?? 0;
      log.push([performance.now(), bregma.scene?.tools.length ?? 0, bregma.cover?.title ?? "", owed]);
    };
    (globalThis as unknown as { watched: typeof log }).watched = log;
    setInterval(look, 5);
  });
}

const seen = () =>
  open.page.evaluate(
    () => (globalThis as unknown as { watched: [number, number][] }).watched.filter(([, tools]) => tools > 0).length,
  );
const watched = () =>
  open.page.evaluate(() =>
    (globalThis as unknown as { watched: [number, number, string, number][] }).watched.splice(0),
  );

async function covered(title: string, resume: () => void | Promise<void>): Promise<void> {
  await untilCover(open.page, title);
  await noProbeInThePicture();
  await open.page.screenshot({ path: `${shots}/${title.replaceAll(" ", "_")}.png` });
  await resume();
  await untilPicture(open.page);
  await untilTool(open.page);
}

test("a gateway that stops: the probe is gone at its time, the cover comes after 1 s, the picture by itself", async () => {
  await watch();
  await until(
    () => seen(),
    (n) => n > 0,
    "the probe was seen",
  );
  open.gateway.paused = true;
  await untilNoTool();
  await noProbeInThePicture();
  const log = await watched();
  await covered("Connection lost", () => {
    open.gateway.paused = false;
  });
  // The last frame's pose ended 290 ms after it was written; then one draw.
  const gone = log.filter(([, tools]) => tools > 0).at(-1)!;
  const draw = await open.page.evaluate(() => Math.max(...bregma.times.times.slice(-20).map((t) => t.draw_ms)));
  assert.ok(
    gone[0] - gone[3] < 290 + 2 * draw + 100,
    `${gone[0] - gone[3]} ms after the last frame or acknowledgement; draws of ${draw} ms`,
  );
});

test("a socket that is cut while nothing answers", async () => {
  open.gateway.paused = true;
  open.gateway.cut();
  await untilNoTool();
  await covered("Connection lost", () => {
    open.gateway.paused = false;
  });
});

test("a socket that is cut is opened again without a reload", async () => {
  const bytes = await open.page.evaluate(() => bregma.link.bytes);
  open.gateway.cut();
  await until(
    () => open.page.evaluate(() => bregma.link.bytes),
    (b) => b > bytes,
    "frames",
  );
  await untilTool(open.page);
});

test("a daemon that stops while the gateway goes on", async () => {
  open.gateway.frozen = true;
  await untilNoTool();
  await covered("No navigation state", () => {
    open.gateway.frozen = false;
  });
});

test("a daemon that the gateway calls silent", async () => {
  open.gateway.link = { presence: 1, silent_ms: 1200 };
  await covered("bregmad is silent", () => {
    open.gateway.link = {};
  });
});

test("without a case the picture is covered; alarms and the pages that need no case stay", async () => {
  open.gateway.set("alarm", { alarm: "disk_low", severity: 2, state: 1, text: "4 GB are left.", count: 1 });
  open.gateway.case = { state: 0, hash: "", text: "Load a case." };
  const says = async (tab: string, wanted: RegExp) => {
    await open.page.getByRole("tab", { name: tab }).click();
    await until(
      () => textOf(open.page, ".side-panel"),
      (text) => wanted.test(text),
      `${tab} says ${wanted}`,
    );
  };
  await untilCover(open.page, "No case");
  await untilNoTool();
  const alarms = await open.page.locator(".alarm").getByText("4 GB are left.").isVisible();
  await says("System", /Daemontest/);
  await says("Scanner", /No scanner is known/);
  await says("Guide", /^Shown with a case\.$/);
  await open.page.screenshot({ path: `${shots}/No_case.png` });
  open.gateway.case = {};
  await untilPicture(open.page);
  await untilTool(open.page);
  assert.ok(alarms);
  await says("Guide", /mm/);
});

test("after a restart of the daemon the probe is shown as unverified", async () => {
  open.gateway.tool = (now) => ({ ...lasting(now), status: 2 });
  await until(
    () => countColour(open.page, "overlay", kColours.unverified),
    (n) => n > 30,
    "the unverified probe",
  );
  assert.equal(await countColour(open.page, "overlay", kColours.live), 0);
  await untilStatus(/NOT VERIFIED/);
  open.gateway.tool = lasting;
  await until(
    () => countColour(open.page, "overlay", kColours.live),
    (n) => n > 30,
    "the verified probe",
  );
});

test("a tool that is hidden, refused or without numbers is not drawn, and the reason is stated", async () => {
  for (const [change, text] of [
    [{ status: 5 }, /not seen by the camera/],
    [{ status: 1, plausibility: 3 }, /pose refused/],
    [{ status: 9, plausibility_reason: 5 }, /data refused: jumped/],
    [{ status: 99 }, /unknown \(99\)/],
  ] as const) {
    open.gateway.tool = (now) => ({ ...lasting(now), ...change });
    await untilNoTool();
    await drawn(open.page);
    await noProbeInThePicture();
    await untilStatus(text);
    open.gateway.tool = lasting;
    await untilTool(open.page);
  }
});

test("a tab in the background", async () => {
  const hide = (hidden: boolean) =>
    open.page.evaluate((h) => {
      Object.defineProperty(document, "hidden", { value: h, configurable: true });
      document.dispatchEvent(new Event("visibilitychange"));
    }, hidden);
  await hide(true);
  await covered("Page in the background", () => hide(false));
});

test("a computer that slept: its timer stood still, its wall clock did not", async () => {
  await open.page.evaluate(() => {
    const now = Date.now.bind(Date);
    Date.now = () => now() + 10_000;
  });
  await until(
    () =>
      open.page.evaluate(
        () =>
          [
            bregma.cover?.title ?? "",
            bregma.link.clock.step_ms({ timer_ms: performance.now(), wall_ms: Date.now() }),
          ] as const,
      ),
    ([title, step]) => title === "" && Math.abs(step) < 20,
    "the clock is measured anew",
  );
  await untilTool(open.page);
});

test("a lost graphics context", async () => {
  await open.page.evaluate(() => {
    (globalThis as unknown as { lost: { restore(): void } }).lost = bregma.display.loseContext();
  });
  await untilCover(open.page, "Graphics interrupted");
  await open.page.screenshot({ path: `${shots}/Graphics_interrupted.png` });
  await open.page.evaluate(() => (globalThis as unknown as { lost: { restore(): void } }).lost.restore());
  await untilPicture(open.page);
  await untilTool(open.page);
  await drawn(open.page);
  assert.ok((await countColour(open.page, "picture", "#000000", 0)) > 1000);
});

test("nothing failed in the page", () => assert.deepEqual(open.errors, []));
