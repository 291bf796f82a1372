import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { mkdtempSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { after, before, test } from "node:test";
import type { Browser, Page } from "playwright-core";
import { orthogonalPlane, type Plane, toImage } from "../../src/geometry/planes.ts";
import {
  apply,
  grey,
  indexFromImage,
  sampleLinear,
  type Volume,
  type Voxels,
  type Window,
} from "../../src/image/volume.ts";
import { launchBrowser, pageWith } from "../support/browser.ts";
import { Random } from "../support/random.ts";
import type { SliceRequest, SlicesApi } from "./pages/slices.ts";

declare const slices: SlicesApi; // in the page

const kPixels = 192;
let browser: Browser;
let page: Page;
const random = new Random(6);

before(async () => {
  browser = await launchBrowser();
  page = await pageWith(browser, "slices");
});
after(() => browser?.close());

// An image with steep edges, noise and an oblique grid whose voxels are not cubes.
function phantom(type: "int16" | "uint16" | "uint8" | "float32", top: number): Volume {
  const arrays = { int16: Int16Array, uint16: Uint16Array, uint8: Uint8Array, float32: Float32Array };
  const size = [61, 47, 39] as const;
  const voxels = new arrays[type](size[0] * size[1] * size[2]) as Voxels;
  const low = type === "int16" ? -1024 : 0;
  for (let k = 0, n = 0; k < size[2]; ++k) {
    for (let j = 0; j < size[1]; ++j) {
      for (let i = 0; i < size[0]; ++i, ++n) {
        const ring = Math.floor(Math.hypot(i - 30, 1.3 * (j - 23), 1.6 * (k - 19)) / 4) % 2;
        voxels[n] = low + (top - low) * (0.35 * ring + 0.3 * (i / 60) + 0.3 * random.uniform());
      }
    }
  }
  const r = random.rotation();
  const spacing = [0.9, 1.1, 1.7];
  const rows = [0, 1, 2].flatMap((d) => [r[d] * spacing[0], r[3 + d] * spacing[1], r[6 + d] * spacing[2], 4 * d - 5]);
  const centre = apply(rows, [30, 23, 19]);
  [3, 7, 11].forEach((at, d) => {
    rows[at] -= centre[d];
  });
  return { size, T_image_index: rows, voxels };
}

// Planes parallel to the axes of Image, and of the grid itself, and any.
function somePlanes(volume: Volume): Plane[] {
  const T = volume.T_image_index;
  const axis = (c: number) => {
    const v = [T[c], T[4 + c], T[8 + c]];
    const length = Math.hypot(...v);
    return [v[0] / length, v[1] / length, v[2] / length] as const;
  };
  const planes: Plane[] = [
    ...(["axial", "coronal", "sagittal"] as const).map((kind) =>
      orthogonalPlane(kind, [1.3, -2.1, 0.4], "radiological"),
    ),
    { centre: apply(T, [30, 23, 19]), right: axis(0), up: axis(1) },
    { centre: apply(T, [30, 23, 19.5]), right: axis(0), up: axis(2) },
  ];
  for (let k = 0; k < 20; ++k) {
    const r = random.rotation();
    planes.push({
      centre: [random.normal() * 8, random.normal() * 8, random.normal() * 8],
      right: [r[0], r[1], r[2]],
      up: [r[3], r[4], r[5]],
    });
  }
  return planes;
}

async function load(volume: Volume, type: string, name: "load" | "loadSecond" = "load"): Promise<void> {
  const base64 = Buffer.from(volume.voxels.buffer as ArrayBuffer).toString("base64");
  await page.evaluate(
    ([f, t, s, T, b]) => slices[f as "load"](t as "int16", s as Volume["size"], T as number[], b as string),
    [name, type, volume.size, volume.T_image_index, base64] as const,
  );
}

async function draw(request: SliceRequest, what: "image" | "second" | "labels"): Promise<Buffer> {
  return Buffer.from(await page.evaluate(([r, w]) => slices.draw(r, w), [request, what] as const), "base64");
}

// Calls f for each pixel of each plane, with the position of its centre.
function forEachPixel(
  request: SliceRequest,
  f: (image: readonly [number, number, number], pixel: number) => void,
): void {
  const n = request.pixels;
  request.planes.forEach((plane, p) => {
    for (let y = 0; y < n; ++y) {
      for (let x = 0; x < n; ++x) {
        const u = (x + 0.5 - n / 2) * request.mm_per_pixel;
        const v = (y + 0.5 - n / 2) * request.mm_per_pixel;
        f(toImage(plane, u, v), p * n * n + y * n + x);
      }
    }
  });
}

const types: [Parameters<typeof phantom>[0], number, Window][] = [
  ["int16", 3071, { window: 1500, level: 300 }],
  ["uint16", 4095, { window: 3000, level: 1800 }],
  ["uint16", 65535, { window: 50000, level: 30000 }],
  ["uint8", 255, { window: 200, level: 120 }],
  ["float32", 1, { window: 0.7, level: 0.5 }],
];
for (const [type, top, window] of types) {
  test(`panels of a ${type} image up to ${top} equal the linear resample in double precision`, async () => {
    const volume = phantom(type, top);
    await load(volume, type);
    const request: SliceRequest = { planes: somePlanes(volume), mm_per_pixel: 0.41, pixels: kPixels, window };
    const drawn = await draw(request, "image");
    const T = indexFromImage(volume);
    let within1 = 0;
    let total = 0;
    let lit = 0;
    forEachPixel(request, (image, pixel) => {
      const index = apply(T, image);
      // A pixel within a thousandth of a voxel of the image's border may fall on either side.
      if (index.some((x, d) => Math.min(Math.abs(x + 0.5), Math.abs(x - volume.size[d] + 0.5)) < 1e-3)) return;
      const value = sampleLinear(volume, index);
      const difference = Math.abs(drawn[3 * pixel] - (value === null ? 0 : grey(value, window)));
      ++total;
      if (value !== null) ++lit;
      if (difference <= 1) ++within1;
      assert.ok(difference <= 2, `${drawn[3 * pixel]} at ${index.join(" ")} should be ${value}`);
      assert.equal(drawn[3 * pixel], drawn[3 * pixel + 1]);
    });
    assert.ok(lit > total / 5, "the planes go through the image");
    assert.ok(within1 >= 0.999 * total, `${within1} of ${total} within one grey level`);
  });
}

// The reference above is our own: here it is ITK's.
test("panels equal ITK's linear resample", async () => {
  const window: Window = { window: 1500, level: 300 };
  const volume = phantom("int16", 3071);
  await load(volume, "int16");
  const request: SliceRequest = { planes: somePlanes(volume), mm_per_pixel: 0.41, pixels: kPixels, window };
  const drawn = await draw(request, "image");
  const values = itkResample(volume, request);
  let within1 = 0;
  let total = 0;
  values.forEach((value, pixel) => {
    if (Number.isNaN(value)) return;
    const difference = Math.abs(drawn[3 * pixel] - grey(value, window));
    ++total;
    if (difference <= 1) ++within1;
    assert.ok(difference <= 2, `${drawn[3 * pixel]} should be ${value}`);
  });
  assert.ok(total > values.length / 5, "the planes go through the image");
  assert.ok(within1 >= 0.999 * total, `${within1} of ${total} within one grey level`);
});

function itkResample(volume: Volume, request: SliceRequest): Float64Array {
  const folder = mkdtempSync(join(tmpdir(), "bregma-display-"));
  try {
    const T = volume.T_image_index;
    const columns = [0, 1, 2].map((c) => [T[c], T[4 + c], T[8 + c]]);
    const spacing = columns.map((c) => Math.hypot(...c));
    const header = [
      "ObjectType = Image",
      "NDims = 3",
      "BinaryData = True",
      "BinaryDataByteOrderMSB = False",
      `DimSize = ${volume.size.join(" ")}`,
      `ElementSpacing = ${spacing.join(" ")}`,
      `Offset = ${T[3]} ${T[7]} ${T[11]}`,
      `TransformMatrix = ${columns.flatMap((c, i) => c.map((x) => x / spacing[i])).join(" ")}`,
      "ElementType = MET_SHORT",
      "ElementDataFile = LOCAL\n",
    ].join("\n");
    writeFileSync(join(folder, "image.mha"), Buffer.concat([Buffer.from(header), Buffer.from(volume.voxels.buffer)]));
    const lines = request.planes.map((p) =>
      [...p.centre, ...p.right, ...p.up, request.mm_per_pixel, request.pixels].join(" "),
    );
    writeFileSync(join(folder, "planes"), `${lines.join("\n")}\n`);
    const files = ["image.mha", "planes", "values"].map((name) => join(folder, name));
    execFileSync(`${process.env.BREGMA_BUILD}/bin/display_itk_resample`, files);
    return new Float64Array(new Uint8Array(readFileSync(files[2])).buffer);
  } finally {
    rmSync(folder, { recursive: true });
  }
}

test("a second image on a grid of its own is blended over the first", async () => {
  const first = phantom("int16", 3071);
  const second = phantom("uint8", 255);
  await load(first, "int16");
  await load(second, "uint8", "loadSecond");
  const window = { window: 400, level: 150 };
  const request: SliceRequest = { planes: somePlanes(first).slice(0, 8), mm_per_pixel: 0.41, pixels: kPixels, window };
  const drawn = await draw(request, "second");
  const [T1, T2] = [indexFromImage(first), indexFromImage(second)];
  let blended = 0;
  let wrong = 0;
  forEachPixel(request, (image, pixel) => {
    const a = sampleLinear(first, apply(T1, image));
    const b = sampleLinear(second, apply(T2, image));
    const base = a === null ? 0 : grey(a, window);
    const expected = b === null ? base : (base + grey(b, window)) / 2;
    if (b !== null) ++blended;
    if (Math.abs(drawn[3 * pixel] - expected) > 2) ++wrong;
  });
  assert.ok(blended > 10000);
  assert.ok(wrong < 50, `${wrong} pixels`); // those at a border of either image
});

test("labels are drawn in their colours, the nearest voxel's", async () => {
  const image = phantom("uint8", 255);
  await load(image, "uint8");
  const voxels = new Int16Array(image.voxels.length);
  for (let n = 0; n < voxels.length; ++n) voxels[n] = [0, 3, 4][Math.floor(n / 61) % 3]; // 4 has no colour
  const labels: Volume = { size: image.size, T_image_index: image.T_image_index, voxels };
  await load(labels, "int16", "loadSecond");
  const window = { window: 255, level: 127.5 };
  const request: SliceRequest = { planes: somePlanes(image).slice(0, 6), mm_per_pixel: 0.37, pixels: kPixels, window };
  const drawn = await draw(request, "labels");
  const T = indexFromImage(image);
  let coloured = 0;
  let wrong = 0;
  forEachPixel(request, (position, pixel) => {
    const index = apply(T, position);
    const value = sampleLinear(image, index);
    if (value === null) return;
    const [i, j, k] = index.map((x, d) => Math.min(Math.max(Math.floor(x + 0.5), 0), image.size[d] - 1));
    const is3 = voxels[i + 61 * (j + 47 * k)] === 3;
    const expected = is3 ? [1, 0, 0.5].map((c) => value / 2 + 127.5 * c) : [value, value, value];
    if (is3) ++coloured;
    if (expected.some((e, c) => Math.abs(drawn[3 * pixel + c] - e) > 2)) ++wrong;
  });
  assert.ok(coloured > 5000);
  assert.ok(wrong < 50, `${wrong} pixels`);
});
