// The interactions of the thesis' chapter 6, and those that were added.
import assert from "node:assert/strict";
import { after, before, test } from "node:test";
import type { App } from "../../src/page/app.ts";
import { kColours } from "../../src/view/colours.ts";
import { insertion } from "../support/fake_gateway.ts";
import { record } from "../support/frames.ts";
import {
  countColour,
  countRed,
  cursorOf,
  drawn,
  type OpenPage,
  openPage,
  panelSum,
  pixelOf,
  textOf,
  until,
  untilTool,
} from "../support/page_probe.ts";

declare const bregma: App; // in the page

let open: OpenPage;
const kPanels = [0, 1, 2, 3];
const [kAxial, kCoronal, kSagittal, kSpace] = kPanels;

before(async () => {
  open = await openPage((gateway) => {
    // It holds still, and is valid for as long as a pose can be: a test machine may be slow.
    gateway.tool = (now) => ({ ...insertion(now, 0.5), valid_until_ms: now + 290 });
  });
  await untilTool(open.page);
});
after(() => open?.close());

const untilProbe = (panel: number) =>
  until(
    () => countColour(open.page, "overlay", kColours.live, panel),
    (n) => n > 10,
    `the probe in panel ${panel}`,
  );

const near = (a: readonly number[], b: readonly number[], mm: number) =>
  assert.ok(Math.hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]) <= mm, `${a.join(" ")} is not ${b.join(" ")}`);

async function free(cursor: [number, number, number]): Promise<void> {
  await open.page.evaluate((p) => {
    bregma.view.straighten();
    bregma.view.setCursor(p);
    bregma.changed();
  }, cursor);
  await drawn(open.page);
}

async function drag(from: { x: number; y: number }, dx: number, dy: number): Promise<void> {
  const { mouse } = open.page;
  await mouse.move(from.x, from.y);
  await mouse.down();
  await mouse.move(from.x + dx / 2, from.y + dy / 2);
  await mouse.move(from.x + dx, from.y + dy);
  await mouse.up();
  await drawn(open.page);
}

const centreOf = async (panel: number, dx = 0, dy = 0) => {
  const rect = await open.page.evaluate((i) => {
    const r = bregma.display.rectOf(i)!;
    const box = bregma.display.element.getBoundingClientRect();
    return { x: box.left + r.x + r.width / 2, y: box.top + r.y + r.height / 2 };
  }, panel);
  return { x: rect.x + dx, y: rect.y + dy };
};

test("four panels show the image: axial, coronal, sagittal and 3-D", async () => {
  for (const panel of kPanels) assert.ok((await countColour(open.page, "picture", "#000000", panel)) > 1000);
  const sums = new Set(await Promise.all(kPanels.map((panel) => panelSum(open.page, panel))));
  assert.equal(sums.size, 4);
});

test("the probe is a line in all panels, at its tip", async () => {
  for (const panel of [kAxial, kCoronal, kSagittal]) await untilProbe(panel);
  const tip = insertion(0, 0.5).tip_mm;
  near(await cursorOf(open.page), tip, 1e-6); // the planes are at the tip
});

test("the tip's coordinates are stated, in the words of the patient", async () => {
  const text = () => textOf(open.page, ".coordinates");
  await until(text, (t) => /Tip\s+R 21\.0\s+A 12\.5\s+S 47\.5/.test(t), "the tip's coordinates");
});

test("the wheel moves the plane of its panel along its normal", async () => {
  await free([5, 5, 5]);
  const before = await panelSum(open.page, kAxial);
  const { x, y } = await centreOf(kAxial);
  await open.page.mouse.move(x, y);
  for (let i = 0; i < 3; ++i) await open.page.mouse.wheel(0, -100);
  await until(
    () => cursorOf(open.page),
    (c) => Math.abs(c[2] - 5) > 2.5,
    "the axial plane has moved",
  );
  await drawn(open.page);
  near(await cursorOf(open.page), [5, 5, 2], 1e-6); // towards the viewer, who is at the feet
  assert.notEqual(await panelSum(open.page, kAxial), before);
});

test("a click sets the cross hair, and all panels follow", async () => {
  await free([0, 0, 0]);
  const wanted = [22, -14, 0];
  const { x, y } = await pixelOf(open.page, kAxial, wanted);
  await open.page.mouse.click(x, y);
  await drawn(open.page);
  near(await cursorOf(open.page), wanted, 0.6);
  const cursor = await cursorOf(open.page);
  // In each panel the lines of the other two planes go through the place of the cross hair.
  for (const [panel, colours] of [
    [kAxial, [kColours.coronal, kColours.sagittal]],
    [kCoronal, [kColours.axial, kColours.sagittal]],
    [kSagittal, [kColours.axial, kColours.coronal]],
  ] as const) {
    const at = await pixelOf(open.page, panel, cursor);
    const hits = await open.page.evaluate(
      ([px, py, wantedColours]) => {
        const canvas = document.querySelectorAll<HTMLCanvasElement>(".picture > canvas")[1];
        const box = canvas.getBoundingClientRect();
        const c = canvas.getContext("2d")!;
        return (wantedColours as readonly string[]).map((css) => {
          const v = Number.parseInt(css.slice(1), 16);
          const rgb = [v >> 16, (v >> 8) & 255, v & 255];
          // On a small square of 20 pixels around the cross hair, the line leaves on two opposite sides.
          let found = 0;
          for (let s = -20; s <= 20; ++s) {
            for (const [dx, dy] of [
              [s, -20],
              [s, 20],
              [-20, s],
              [20, s],
            ]) {
              const d = c.getImageData(
                Math.round((px as number) - box.left + dx),
                Math.round((py as number) - box.top + dy),
                1,
                1,
              ).data;
              if (d[3] > 60 && rgb.every((w, k) => Math.abs(d[k] - w) < 45)) {
                if (Math.abs(s) <= 2) ++found;
              }
            }
          }
          return found;
        });
      },
      [at.x, at.y, colours] as const,
    );
    for (const found of hits) assert.ok(found >= 2, `panel ${panel}: ${hits.join(" ")}`);
  }
});

test("a line dragged near the cross hair moves that plane", async () => {
  await free([0, 0, 0]);
  const from = await pixelOf(open.page, kAxial, [0, 22, 0]); // on the sagittal plane's line
  const before = await panelSum(open.page, kSagittal);
  await drag(from, -30, 0);
  const cursor = await cursorOf(open.page);
  assert.ok(cursor[0] > 5, `moved to the patient's right, which is on the left: ${cursor.join(" ")}`);
  assert.ok(Math.abs(cursor[1]) < 1e-6 && Math.abs(cursor[2]) < 1e-6);
  assert.notEqual(await panelSum(open.page, kSagittal), before);
});

test("a line dragged at its end turns the planes obliquely", async () => {
  await free([0, 0, 0]);
  const sums = [await panelSum(open.page, kCoronal), await panelSum(open.page, kSagittal)];
  const from = await pixelOf(open.page, kAxial, [0, 80, 0]);
  await drag(from, 40, 6);
  const [oblique, cosine] = await open.page.evaluate(() => {
    const plane = bregma.view.planeOf("sagittal", bregma.scene!.followed)!;
    return [bregma.view.oblique, -plane.right[1]] as const;
  });
  assert.ok(oblique);
  const angle = (Math.acos(cosine) * 180) / Math.PI;
  assert.ok(angle > 8 && angle < 40, `${angle} degrees`);
  assert.notEqual(await panelSum(open.page, kCoronal), sums[0]);
  assert.notEqual(await panelSum(open.page, kSagittal), sums[1]);
  near(await cursorOf(open.page), [0, 0, 0], 1e-6);
  await open.page.getByRole("button", { name: "Straighten" }).click();
  await drawn(open.page);
  assert.equal(await panelSum(open.page, kSagittal), sums[1]);
});

test("window and level dragged in one panel hold in all", async () => {
  await free([0, 0, 0]);
  const before = await Promise.all(kPanels.map((panel) => panelSum(open.page, panel)));
  const window = await open.page.evaluate(() => bregma.view.window);
  await drag(await centreOf(kCoronal, 40, 40), 60, -40);
  const now = await open.page.evaluate(() => bregma.view.window);
  assert.ok(now.window > window.window && now.level < window.level);
  for (const panel of kPanels) assert.notEqual(await panelSum(open.page, panel), before[panel]);
});

test("a preset sets the window", async () => {
  await open.page.getByRole("button", { name: "CT bone" }).click();
  assert.equal((await open.page.evaluate(() => bregma.view.window)).window, 2500);
  await open.page.getByRole("button", { name: "CT brain" }).click();
  assert.equal((await open.page.evaluate(() => bregma.view.window)).window, 80);
});

test("the 3-D panel is turned by dragging, and zoomed by the wheel", async () => {
  const before = await panelSum(open.page, kSpace);
  await drag(await centreOf(kSpace), 50, 10);
  const turned = await panelSum(open.page, kSpace);
  assert.notEqual(turned, before);
  const { x, y } = await centreOf(kSpace);
  await open.page.mouse.move(x, y);
  await open.page.mouse.wheel(0, -100);
  await until(
    () => panelSum(open.page, kSpace),
    (sum) => sum !== turned,
    "the zoomed panel",
  );
});

test("the three planes are in the 3-D panel, in step with the others", async () => {
  await free([0, 0, 0]);
  const before = await panelSum(open.page, kSpace);
  await free([0, 0, 30]);
  assert.notEqual(await panelSum(open.page, kSpace), before);
  assert.ok((await countColour(open.page, "picture", kColours.axial, kSpace)) > 0, "the cross hair");
});

test("surfaces in 3-D hide what is behind them, and look the same after a turn and back", async () => {
  const tool = open.gateway.tool;
  open.gateway.tool = (now) => ({ ...tool(now), status: 5 }); // its region grows with the age of the pose
  await free([0, 0, 0]);
  // Pixels of the vessel, which is red and within the scalp, and a sum that changes with the picture.
  const vessel = async (scalp: number, turn_rad: number) => {
    await open.page.evaluate(
      ([opacity, angle]) => {
        const { view } = bregma;
        view.opacities = { scalp: opacity, brain: 0, structure: 1, planes: false };
        const [c, s] = [Math.cos(angle), Math.sin(angle)];
        const turned = ([x, y, z]: readonly number[]): [number, number, number] => [c * x - s * y, s * x + c * y, z];
        view.camera = { ...view.camera, right: turned([-0.8, 0.6, 0]), up: turned([-0.12, -0.16, 0.98]) };
        bregma.changed();
      },
      [scalp, turn_rad] as const,
    );
    await drawn(open.page);
    return [await countRed(open.page, kSpace), await panelSum(open.page, kSpace)];
  };
  const [seen, first] = await vessel(0, 0);
  assert.ok(seen > 50, `${seen} pixels`);
  const [behind] = await vessel(1, 0);
  assert.equal(behind, 0);
  const [, turned] = await vessel(0, 0.4);
  assert.notEqual(turned, first);
  assert.deepEqual(await vessel(0, 0), [seen, first]);
  await open.page.evaluate(() => {
    bregma.view.opacities = { scalp: 0.18, brain: 0.35, structure: 1, planes: true };
    bregma.view.follow = true;
  });
  open.gateway.tool = tool;
  await untilTool(open.page);
});

test("pan and zoom leave the cross hair where it is", async () => {
  await free([10, 10, 10]);
  const { x, y } = await centreOf(kAxial, 20, 20);
  await open.page.mouse.move(x, y);
  await open.page.keyboard.down("Control");
  await open.page.mouse.wheel(0, -100);
  await open.page.keyboard.up("Control");
  await until(
    () => open.page.evaluate(() => bregma.view.panels[0].zoom),
    (zoom) => zoom > 1.05,
    "zoomed",
  );
  await open.page.keyboard.down("Shift");
  await drag({ x, y }, 25, 10);
  await open.page.keyboard.up("Shift");
  const panel = await open.page.evaluate(() => bregma.view.panels[0]);
  assert.ok(Math.abs(panel.pan_mm[0]) > 3);
  near(await cursorOf(open.page), [10, 10, 10], 1e-6);
});

test("a double click enlarges a panel, and another one brings the four back", async () => {
  const { x, y } = await centreOf(kCoronal, 30, 30);
  await open.page.mouse.dblclick(x, y);
  await until(
    () => open.page.evaluate(() => bregma.display.rectOf(0) === null),
    (one) => one,
    "one panel",
  );
  const middle = await centreOf(kCoronal, 30, 30);
  await open.page.mouse.dblclick(middle.x, middle.y);
  await until(
    () => open.page.evaluate(() => bregma.display.rectOf(0) !== null),
    (four) => four,
    "four panels",
  );
});

test("between the panels of another layout nothing of the former one remains", async () => {
  await open.page.evaluate(() => {
    bregma.view.big = 0;
  });
  await open.page.getByLabel("layout 1+3").click();
  await drawn(open.page);
  const lit = await open.page.evaluate(() => {
    const canvas = document.querySelector<HTMLCanvasElement>(".picture > canvas")!;
    const right = bregma.display.rectOf(0)!.width;
    const copy = document.createElement("canvas");
    copy.width = 3;
    copy.height = canvas.height;
    copy.getContext("2d")!.drawImage(canvas, -right, 0);
    const { data } = copy.getContext("2d")!.getImageData(0, 0, 3, canvas.height);
    return data.filter((value, i) => i % 4 !== 3 && value > 0).length;
  });
  assert.equal(lit, 0);
  await open.page.getByLabel("layout 2×2").click();
  await drawn(open.page);
});

test("every plane of the probe can be shown", async () => {
  for (const kind of ["probe_eye", "inline_1", "inline_2", "along_plan", "look_ahead"]) {
    await open.page.getByLabel("plane of panel 3").selectOption(kind);
    await drawn(open.page);
    assert.equal(await open.page.evaluate(() => bregma.view.panels[2].kind), kind);
    await untilProbe(2);
  }
  await open.page.getByLabel("plane of panel 3").selectOption("sagittal");
});

test("the convention is stated, and changes sides", async () => {
  const button = open.page.getByLabel("convention", { exact: true });
  assert.equal(await button.textContent(), "Radiological");
  const right = () => open.page.evaluate(() => bregma.view.planeOf("axial", bregma.scene!.followed)!.right[0]);
  assert.equal(await right(), -1);
  await button.click();
  await drawn(open.page);
  assert.equal(await button.textContent(), "Neurological");
  assert.equal(await right(), 1);
  await button.click();
});

test("a distance is measured between two points", async () => {
  await free([0, 0, 0]);
  await open.page.evaluate(() => {
    bregma.view.panels[1] = { kind: "coronal", zoom: 1, pan_mm: [0, 0] };
    bregma.changed();
  });
  await drawn(open.page);
  await open.page.getByRole("button", { name: "Measure", exact: true }).click();
  const from = await pixelOf(open.page, kCoronal, [30, 0, -20]);
  const to = await pixelOf(open.page, kCoronal, [-10, 0, 10]);
  await drag(from, to.x - from.x, to.y - from.y);
  const [m] = await open.page.evaluate(() => bregma.view.measurements);
  assert.ok(Math.abs(Math.hypot(...m.to.map((v, d) => v - m.from[d])) - 50) < 1.5);
  await open.page.getByRole("button", { name: "clear measurements" }).click();
  await open.page.getByRole("button", { name: "Window", exact: true }).click();
});

test("a screenshot is saved", async () => {
  await open.page.evaluate(() => {
    bregma.view.follow = true;
  });
  const [download] = await Promise.all([
    open.page.waitForEvent("download"),
    open.page.getByRole("button", { name: "Screenshot" }).click(),
  ]);
  assert.match(download.suggestedFilename(), /^bregma \d{4}-\d\d-\d\dT.*\.png$/);
});

test("a predicted target is stated beside that as imaged; the plot has what happened before its page was opened", async () => {
  const { page, gateway } = open;
  assert.match(await textOf(page, ".figures"), /Depth left/);
  gateway.tool = (now) => ({
    ...insertion(now, 0.5),
    valid_until_ms: now + 290,
    distance_to_predicted_target_mm: 31.4,
  });
  const model = { point: "Lesion", status: 2, imaged_mm: [12, 5, 20], displaced_mm: [15, 5, 16], error_bound_mm: 1.25 };
  for (let step = 1; step <= 12; ++step) {
    const state = { ...model, time_ms: step, depth_mm: 3 * step, tip_force_N: 0.01 * step, ruptures: 0 };
    gateway.others.set("model", record("deformation", state));
    await drawn(page);
  }
  const text = await textOf(page, ".figures");
  assert.match(text, /Depth left[\s\S]*To predicted target\s*moved 5\.0 ± 1\.3[\s\S]*31\.4/);
  gateway.others.set(
    "model",
    record("deformation", { ...model, status: 3, time_ms: 13, depth_mm: 36, tip_force_N: 0.12 }),
  );
  await until(
    () => textOf(page, ".figure.warn"),
    (warning) => /extrapolated, moved 5\.0 ± 1\.3/.test(warning),
    "an extrapolated prediction says so",
  );
  await page.click(".tabs button:has-text('Brain')");
  await drawn(page);
  const yellow = await page.evaluate(() => {
    const { width, height } = document.querySelector<HTMLCanvasElement>(".plot")!;
    const c = document.querySelector<HTMLCanvasElement>(".plot")!.getContext("2d")!;
    const { data } = c.getImageData(0, 0, width, height);
    let [left, right] = [width, 0];
    for (let i = 0; i < data.length; i += 4) {
      const x = (i / 4) % width;
      const inside = x > 100 && x < width - 100 && i / 4 / width > 70; // neither numbers nor names
      if (!inside || data[i] < 200 || data[i + 1] < 180 || data[i + 2] > 140 || data[i + 3] < 100) continue;
      [left, right] = [Math.min(left, x), Math.max(right, x)];
    }
    return right - left;
  });
  assert.ok(yellow > 300, `the curve of the force is ${yellow} pixels wide`);
  gateway.others.delete("model");
  await page.click(".tabs button:has-text('Guide')");
});

test("the other pages open", async () => {
  for (const name of ["Register", "Verify", "Brain", "Camera", "Scanner", "System", "Guide"]) {
    await open.page.getByRole("tab", { name }).click();
    await drawn(open.page);
  }
  assert.equal(await open.page.locator(".figures").isVisible(), true);
});

test("nothing is fetched from another address, and nothing failed", () => {
  const origin = new URL(open.page.url()).origin;
  for (const url of open.requests) assert.ok(url.startsWith(origin) || url.startsWith(`blob:${origin}`), url);
  assert.deepEqual(open.errors, []);
});
