// What lies over the image: labels in colours, a second image on another grid, and a scanner's slice with a pose of its own.
import assert from "node:assert/strict";
import { after, before, test } from "node:test";
import type { App } from "../../src/page/app.ts";
import { kColours } from "../../src/view/colours.ts";
import { insertion } from "../support/fake_gateway.ts";
import { record, type TestRecord } from "../support/frames.ts";
import {
  countColour,
  drawn,
  type OpenPage,
  openPage,
  textOf,
  until,
  untilCover,
  untilPicture,
  untilTool,
} from "../support/page_probe.ts";

declare const bregma: App; // in the page

let open: OpenPage;
const kAxial = 0;
const kSagittal = 2;

before(async () => {
  open = await openPage((gateway) => {
    gateway.tool = (now) => ({ ...insertion(now, 0.5), valid_until_ms: now + 290 });
  });
  await untilTool(open.page);
  await open.page.evaluate(() => {
    bregma.view.setCursor([0, 0, 0]);
    bregma.view.window = { window: 10_000, level: 6500 }; // black
    bregma.changed();
  });
  await drawn(open.page);
});
after(() => open?.close());

// Grey level of the axial panel's picture at a point of Image.
const colourAt = (panel: number, point: readonly [number, number, number]): Promise<number[]> =>
  open.page.evaluate(
    ([index, p]) => {
      const { x, y } = bregma.display
        .penOf(index as number, bregma.view, bregma.scene!)!
        .pixel(p as [number, number, number]);
      const copy = document.createElement("canvas");
      copy.width = copy.height = 1;
      const c = copy.getContext("2d")!;
      c.drawImage(document.querySelector<HTMLCanvasElement>(".picture > canvas")!, -Math.round(x), -Math.round(y));
      return [...c.getImageData(0, 0, 1, 1).data.slice(0, 3)];
    },
    [panel, point] as const,
  );

const kInside: [number, number, number] = [-12, -4, 0]; // in the second grid, and in its labelled half
const kBeside: [number, number, number] = [12, 4, 0]; // in the second grid
const kOutside: [number, number, number] = [40, 40, 0];

test("labels are drawn in their colours, when chosen", async () => {
  assert.deepEqual(await colourAt(kAxial, kInside), [0, 0, 0]);
  await open.page.getByRole("button", { name: "Labels" }).click();
  await drawn(open.page);
  const [red, green, blue] = await colourAt(kAxial, kInside);
  assert.ok(red === 0 && blue === 0 && Math.abs(green - 255 * 0.35) <= 1, `${green}`);
  assert.deepEqual(await colourAt(kAxial, kBeside), [0, 0, 0]);
  assert.match(await textOf(open.page, ".coordinates"), /Region {2}–/);
  await open.page.evaluate((point) => {
    bregma.view.setCursor(point);
    bregma.changed();
  }, kInside);
  await drawn(open.page);
  assert.match(await textOf(open.page, ".coordinates"), /Region {2}Left half/);
  await open.page.evaluate(() => bregma.view.setCursor([0, 0, 0]));
  await open.page.getByRole("button", { name: "Labels" }).click();
  await drawn(open.page);
  assert.doesNotMatch(await textOf(open.page, ".coordinates"), /Region/);
});

test("a second image on another grid is blended over the first", async () => {
  await open.page.getByLabel("second image", { exact: true }).selectOption("Second MR");
  await open.page.getByLabel("blend of both").fill("0.5");
  await drawn(open.page);
  for (const point of [kInside, kBeside]) {
    for (const value of await colourAt(kAxial, point)) assert.ok(Math.abs(value - 127.5) <= 1, `${value}`);
  }
  assert.deepEqual(await colourAt(kAxial, kOutside), [0, 0, 0]);
  // Its registration was not found to be good, and that is stated in each panel.
  const warned = await countColour(open.page, "overlay", kColours.unverified, kAxial);
  await open.page.getByLabel("blend of both").fill("1");
  await drawn(open.page);
  assert.deepEqual(await colourAt(kAxial, kInside), [255, 255, 255]);
  const coordinates = async () => (await open.page.locator(".coordinates").textContent()) ?? "";
  const shown =
    /Tip {2}([RL]) ([\d.]+) {3}([AP]) ([\d.]+) {3}([SI]) ([\d.]+)[\s\S]*Tip in Second MR {2}([RL]) ([\d.]+)/;
  await until(coordinates, (text) => shown.test(text), "the tip in both images");
  const [, , , ap, a, , , rl, r] = shown.exec(await coordinates())!;
  const anterior = ap === "A" ? Number(a) : -Number(a);
  assert.ok(Math.abs(anterior + 3 - (rl === "R" ? Number(r) : -Number(r))) < 0.11, "a quarter turn and a shift");
  await open.page.getByLabel("second image", { exact: true }).selectOption("");
  await drawn(open.page);
  assert.deepEqual(await colourAt(kAxial, kInside), [0, 0, 0]);
  assert.ok(warned > (await countColour(open.page, "overlay", kColours.unverified, kAxial)) + 100, `${warned}`);
});

// 30 x 20 pixels of 2 mm, bright on the left; its plane is oblique.
function slice(change: Partial<Parameters<typeof record<"slice">>[1]>, now_ms: number): TestRecord {
  const pixels = new Uint16Array(600).map((_, i) => (i % 30 < 15 ? 4000 : 100));
  const head = record("slice", {
    device: "MR",
    published_ms: now_ms,
    number: 3,
    columns: 30,
    rows: 20,
    spacing_mm: [2, 2],
    thickness_mm: 4,
    protocol: "verify",
    series: 2,
    index: 1,
    count: 5,
    correction: 5,
    max_shift_mm: 1.4,
    tip_status: 1,
    tip_tool: "Needle",
    tip_pixel: [10, 8],
    tip_distance_mm: 0.6,
    tip_direction: [0, 1, 0],
    tip_error_95_mm: 1.2,
    ...change,
  });
  return { ...head, tail: new Uint8Array(pixels.buffer) } as TestRecord;
}

test("a slice of a scanner that is registered to the image lies in it, with a plane of its own", async () => {
  const [c, s] = [Math.cos(0.5), Math.sin(0.5)];
  // x along a row, y along a column, z the normal: columns of the rotation.
  const rotation = [c, 0, -s, s, 0, c, 0, -1, 0];
  const centre = [20, 10, 15];
  const half = [29, 19]; // half of the extent, in mm
  const corner = [0, 1, 2].map((r) => centre[r] - rotation[3 * r] * half[0] - rotation[3 * r + 1] * half[1]);
  open.gateway.others.set(
    "slice",
    slice({ image_rotation: rotation, image_translation_mm: corner }, open.gateway.now_ms()),
  );
  await open.page.getByLabel("plane of panel 3").selectOption("scanner");
  await until(
    () => open.page.evaluate(() => bregma.scene?.slice?.registered ?? false),
    (registered) => registered,
    "the slice",
  );
  await drawn(open.page);
  const at = (across: number, down: number): [number, number, number] =>
    [0, 1, 2].map((r) => centre[r] + rotation[3 * r] * across + rotation[3 * r + 1] * down) as [number, number, number];
  await open.page.evaluate(() => {
    bregma.view.secondBlend = 1;
    bregma.changed();
  });
  await drawn(open.page);
  assert.deepEqual(await colourAt(kSagittal, at(-20, 5)), [255, 255, 255]);
  assert.deepEqual(await colourAt(kSagittal, at(20, 5)), [0, 0, 0]);
  const plane = await open.page.evaluate(() => bregma.view.scannerPlane!);
  for (let r = 0; r < 3; ++r) {
    assert.ok(Math.abs(plane.centre[r] - centre[r]) < 1e-9);
    assert.ok(Math.abs(plane.right[r] - rotation[3 * r]) < 1e-9);
  }
});

test("a slice of a scanner that is not registered is shown alone, with the robot's tip while that is live", async () => {
  const live = () => open.gateway.others.set("slice", slice({ number: 4 }, open.gateway.now_ms() + 60_000)); // does not become old here
  live();
  await until(
    () => open.page.evaluate(() => bregma.scene?.slice?.registered === false && bregma.scene.slice.tip !== null),
    (seen) => seen,
    "the slice and its tip",
  );
  await drawn(open.page);
  assert.ok((await countColour(open.page, "overlay", kColours.live, kSagittal)) > 20);
  assert.deepEqual(await colourAt(kSagittal, [10, -20, 0]), [255, 255, 255]);
  assert.deepEqual(await colourAt(kSagittal, [50, -20, 0]), [0, 0, 0]);

  open.gateway.others.set("slice", slice({ number: 5 }, open.gateway.now_ms() - 301));
  await until(
    () => open.page.evaluate(() => bregma.scene?.slice?.tip === null),
    (gone) => gone,
    "an old tip is not drawn",
  );
  await drawn(open.page);
  assert.equal(await countColour(open.page, "overlay", kColours.live, kSagittal), 0);
  open.gateway.others.delete("slice");
});

test("without a case the slice is shown by itself, in one panel", async () => {
  const { gateway, page } = open;
  gateway.case = { state: 0, hash: "", text: "Load a case." };
  gateway.others.set("scanner", record("scanner", { device: "MR" }));
  gateway.others.set("slice", slice({ number: 6 }, gateway.now_ms() - 12_000));
  await until(
    () => page.evaluate(() => [bregma.cover?.title ?? "", bregma.scene?.slice?.record.number ?? 0] as const),
    ([cover, number]) => cover === "" && number === 6,
    "the slice",
  );
  await drawn(page);
  const rects = await page.evaluate(() => [0, 1, 2, 3].map((i) => bregma.display.rectOf(i)));
  assert.ok(rects[0] !== null && rects.slice(1).every((rect) => rect === null));
  assert.ok((await countColour(page, "picture", "#ffffff", 0)) > 10_000);
  assert.ok((await countColour(page, "overlay", kColours.unverified, 0)) > 50, "12 s old, not registered");
  gateway.others.set("slice", record("slice", { device: "MR" }, true));
  gateway.others.set("scanner", record("scanner", { device: "MR" }, true));
  await untilCover(page, "No case");
  gateway.others.delete("slice");
  gateway.others.delete("scanner");
  gateway.case = {};
  await untilPicture(page);
});

test("the page of the scanner shows the step, the validity and the coils", async () => {
  const said = {
    device: "MR",
    step: 10,
    activity: 2,
    text: "registered",
    next: "confirm verify",
    verdict: 2,
    tre_95_mm: 0.31,
    validity: 2,
    accepted_revision: 1,
    accepted_tre_95_mm: 0.31,
    field_status: 2,
  };
  open.gateway.others.set("scanner", record("scanner", said));
  open.gateway.others.set(
    "coil",
    record("scanner_coil", { device: "MR", coil: "mid-top-1", outcome: 3, residual_mm: 4 }),
  );
  await open.page.getByRole("tab", { name: "Scanner" }).click();
  const text = async () => (await open.page.locator("#scanner-page").textContent()) ?? "";
  await until(text, (t) => /Valid, predicted error at the target 0\.31 mm/.test(t), "the registration");
  assert.match(await text(), /confirm verify[\s\S]*mid-top-1left out4\.00/);
  open.gateway.others.set("scanner", record("scanner", { ...said, validity: 3, validity_text: "the table moved" }));
  await until(text, (t) => t.includes("Void: the table moved"), "the registration is void");
  assert.ok(await open.page.locator("#scanner-page .lead.bad").count());
  open.gateway.others.delete("scanner");
  open.gateway.others.delete("coil");
});

test("nothing failed in the page", () => assert.deepEqual(open.errors, []));
