// A screen without a mouse, and the tone of alarms.
import assert from "node:assert/strict";
import { after, before, test } from "node:test";
import type { CDPSession } from "playwright-core";
import type { App } from "../../src/page/app.ts";
import { insertion } from "../support/fake_gateway.ts";
import { cursorOf, drawn, type OpenPage, openPage, pixelOf, textOf, until, untilTool } from "../support/page_probe.ts";

declare const bregma: App; // in the page

const kAxial = 0;
const kCoronal = 1;
const kSpace = 3;

let open: OpenPage;
let fingers: CDPSession;

before(async () => {
  open = await openPage((gateway) => {
    gateway.tool = (now) => ({ ...insertion(now, 0.5), valid_until_ms: now + 290 });
  });
  fingers = await open.page.context().newCDPSession(open.page);
  await fingers.send("Emulation.setTouchEmulationEnabled", { enabled: true, maxTouchPoints: 5 });
  await untilTool(open.page);
});
after(() => open?.close());

interface Point {
  readonly x: number;
  readonly y: number;
}

// Fingers go down at the first places, move through the others, and are lifted.
async function touch(...places: readonly (readonly Point[])[]): Promise<void> {
  const send = (type: "touchStart" | "touchMove" | "touchEnd", points: readonly Point[]) =>
    fingers.send("Input.dispatchTouchEvent", { type, touchPoints: points.map((p, id) => ({ x: p.x, y: p.y, id })) });
  await send("touchStart", places[0]);
  for (const points of places.slice(1)) await send("touchMove", points);
  await send("touchEnd", []);
}

// One finger from a place to another, in steps.
const swipe = (from: Point, dx: number, dy: number) =>
  touch(...[0, 0.25, 0.5, 0.75, 1].map((t) => [{ x: from.x + t * dx, y: from.y + t * dy }]));

const centreOf = (panel: number, dx = 0, dy = 0): Promise<Point> =>
  open.page.evaluate(
    ([index, x, y]) => {
      const rect = bregma.display.rectOf(index)!;
      const box = bregma.display.element.getBoundingClientRect();
      return { x: box.left + rect.x + rect.width / 2 + x, y: box.top + rect.y + rect.height / 2 + y };
    },
    [panel, dx, dy] as const,
  );

async function free(point: readonly [number, number, number]): Promise<void> {
  await open.page.evaluate((p) => {
    bregma.view.setCursor(p as [number, number, number]);
    bregma.changed();
  }, point);
  await drawn(open.page);
}

function near(actual: readonly number[], wanted: readonly number[], limit: number): void {
  wanted.forEach((w, d) => {
    assert.ok(Math.abs(actual[d] - w) <= limit, `${actual} instead of ${wanted}`);
  });
}

test("a tap sets the cross hair", async () => {
  const sound = open.page.getByRole("button", { name: "Sound", exact: true });
  assert.equal(await sound.textContent(), "Sound: click"); // nothing was touched yet
  await free([0, 0, 0]);
  await touch([await pixelOf(open.page, kAxial, [25, -20, 0])]);
  await until(
    () => cursorOf(open.page),
    ([x]) => Math.abs(x - 25) < 1,
    "the cross hair",
  );
  near(await cursorOf(open.page), [25, -20, 0], 1);
});

test("a finger beside a plane's line moves the plane", async () => {
  await free([0, 0, 0]);
  const from = await pixelOf(open.page, kAxial, [0, 30, 0]); // on the line of the sagittal plane
  const to = await pixelOf(open.page, kAxial, [20, 30, 0]);
  const beside = 12 * Math.sign(to.x - from.x); // pixels: a mouse would not catch it
  await swipe({ x: from.x + beside, y: from.y }, to.x - from.x, 0);
  const end = [20 * (1 + beside / (to.x - from.x)), 0, 0];
  await until(
    () => cursorOf(open.page),
    ([x]) => Math.abs(x - end[0]) < 1,
    "the sagittal plane",
  );
  near(await cursorOf(open.page), end, 1);
});

test("a finger sets window and level, and with Slice it moves the plane", async () => {
  await free([0, 0, 0]);
  const before = await open.page.evaluate(() => bregma.view.window);
  const from = await centreOf(kCoronal, 40, 40);
  await swipe(from, 50, -30);
  const now = await open.page.evaluate(() => bregma.view.window);
  assert.ok(now.window > before.window && now.level < before.level);
  near(await cursorOf(open.page), [0, 0, 0], 1e-9);

  await open.page.getByRole("button", { name: "Slice" }).click();
  await swipe(from, 0, -40);
  const cursor = await until(
    () => cursorOf(open.page),
    (p) => Math.abs(p[1]) > 5,
    "the coronal plane",
  );
  near(cursor, [0, cursor[1], 0], 1e-6);
  assert.ok(Math.abs(cursor[1]) <= 10.5, `${cursor}`); // 4 pixels per mm
  assert.deepEqual(await open.page.evaluate(() => bregma.view.window), now);
  await open.page.getByRole("button", { name: "Window", exact: true }).click();
});

test("two fingers zoom and pan, and turn nothing else", async () => {
  await free([0, 0, 0]);
  const { x, y } = await centreOf(kAxial);
  const pair = (half: number, dx: number) => [
    { x: x - half + dx, y },
    { x: x + half + dx, y },
  ];
  await touch(pair(30, 0), pair(45, 8), pair(60, 16));
  const panel = await until(
    () => open.page.evaluate(() => bregma.view.panels[0]),
    ({ zoom }) => zoom > 1.5,
    "the zoom",
  );
  assert.ok(Math.abs(panel.zoom - 2) < 0.15, `${panel.zoom}`);
  assert.ok(Math.abs(panel.pan_mm[0]) > 3, `${panel.pan_mm}`);
  near(await cursorOf(open.page), [0, 0, 0], 1e-9);

  const camera = await open.page.evaluate(() => bregma.view.cameraZoom);
  const space = await centreOf(kSpace);
  const at = (half: number) => [
    { x: space.x, y: space.y - half },
    { x: space.x, y: space.y + half },
  ];
  await touch(at(60), at(45), at(30));
  await until(
    () => open.page.evaluate(() => bregma.view.cameraZoom),
    (zoom) => zoom < 0.6 * camera,
    "the smaller head",
  );
});

test("a finger turns the head, and a double tap enlarges a panel", async () => {
  const before = await open.page.evaluate(() => bregma.view.camera.right);
  await swipe(await centreOf(kSpace), 40, 5);
  const now = await open.page.evaluate(() => bregma.view.camera.right);
  assert.ok(Math.hypot(...now.map((v, d) => v - before[d])) > 0.1);
  const one = () => open.page.evaluate(() => bregma.display.rectOf(0) === null);
  for (const wanted of [true, false]) {
    const place = await centreOf(kCoronal, 20, 20);
    await touch([place]);
    await touch([place]);
    await until(one, (alone) => alone === wanted, wanted ? "one panel" : "four panels");
  }
});

// Tones that the page plays from now on.
const tones = () => open.page.evaluate(() => (globalThis as unknown as { tones: number }).tones);
const raise = (alarm: string, severity: number, state = 1, count = 1) =>
  open.gateway.set("alarm", { alarm, subject: "", state, severity, count, text: "a test" }, alarm);

test("an alarm sounds once, a critical one until it is acknowledged", async () => {
  await open.page.evaluate(() => {
    const seen = globalThis as unknown as { tones: number };
    seen.tones = 0;
    const create = AudioContext.prototype.createOscillator;
    AudioContext.prototype.createOscillator = function () {
      ++seen.tones;
      return create.call(this);
    };
  });
  await until(
    () => open.page.evaluate(() => document.querySelector('[aria-label="Sound"]')?.classList.contains("on") ?? false),
    (on) => on,
    "sound, after the first touch",
  );
  raise("drift", 2);
  await until(tones, (n) => n === 1, "a tone");
  raise("note", 1);
  await until(
    () => textOf(open.page, ".alarms"),
    (text) => text.includes("note"),
    "the note",
  );
  assert.equal(await tones(), 1);
  raise("tracker_lost", 3);
  await until(tones, (n) => n >= 7, "the tones, and again"); // three each, repeated after 4 s
  raise("tracker_lost", 3, 2);
  await until(
    () => open.page.locator(".alarm.critical.acknowledged").count(),
    (n) => n === 1,
    "acknowledged",
  );
  const heard = await tones();
  await new Promise((resolve) => setTimeout(resolve, 4500));
  assert.equal(await tones(), heard);
});

test("one click ends the sound, and another one brings it back", async () => {
  const button = open.page.getByRole("button", { name: "Sound", exact: true });
  await button.click();
  await until(
    () => open.page.evaluate(() => document.querySelector('[aria-label="Sound"]')?.classList.contains("on") ?? true),
    (on) => !on,
    "no sound",
  );
  const before = await tones();
  raise("drift", 2, 1, 2);
  await until(
    () => textOf(open.page, ".alarms"),
    (text) => text.includes("2×"),
    "the alarm, again",
  );
  await drawn(open.page);
  assert.equal(await tones(), before);
  await button.click();
  raise("drift", 2, 1, 3);
  await until(tones, (n) => n === before + 1, "a tone");
});

test("nothing failed in the page", () => assert.deepEqual(open.errors, []));
