import assert from "node:assert/strict";
import { test } from "node:test";
import { apply, grey, indexFromImage, sampleLinear, sampleNearest, type Volume } from "../../src/image/volume.ts";
import { Random } from "../support/random.ts";

const random = new Random(3);

test("the grid's inverse is its inverse", () => {
  for (let k = 0; k < 100; ++k) {
    const m = Array.from({ length: 12 }, () => random.normal());
    const grid = { size: [4, 5, 6] as const, T_image_index: m };
    const p = random.normal3();
    const back = apply(m, apply(indexFromImage(grid), p));
    for (let d = 0; d < 3; ++d) assert.ok(Math.abs(back[d] - p[d]) < 1e-8);
  }
});

test("linear interpolation is exact for a linear image, and reaches half a voxel beyond the outer centres", () => {
  const size = [5, 4, 3] as const;
  const voxels = new Float32Array(60);
  for (let k = 0, n = 0; k < 3; ++k)
    for (let j = 0; j < 4; ++j) for (let i = 0; i < 5; ++i) voxels[n++] = 2 * i - 3 * j + 7 * k;
  const volume: Volume = { size, T_image_index: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0], voxels };
  for (let n = 0; n < 1000; ++n) {
    const p = [random.between(0, 4), random.between(0, 3), random.between(0, 2)] as const;
    assert.ok(Math.abs(sampleLinear(volume, p)! - (2 * p[0] - 3 * p[1] + 7 * p[2])) < 1e-9);
  }
  assert.equal(sampleLinear(volume, [-0.4, 0, 0]), 0);
  assert.equal(sampleLinear(volume, [4.4, 3, 2]), 8 - 9 + 14);
  assert.equal(sampleLinear(volume, [-0.51, 0, 0]), null);
  assert.equal(sampleLinear(volume, [0, 0, 2.51]), null);
});

test("the nearest voxel is that in which a point lies", () => {
  const voxels = new Uint8Array([1, 2, 3, 4, 5, 6]);
  const volume: Volume = { size: [3, 2, 1], T_image_index: [2, 0, 0, -10, 0, 4, 0, 5, 0, 0, 3, 7], voxels };
  assert.equal(sampleNearest(volume, [-10, 5, 7]), 1);
  assert.equal(sampleNearest(volume, [-5.1, 7.1, 8.4]), 6);
  assert.equal(sampleNearest(volume, [-8.9, 6.9, 5.6]), 2);
  assert.equal(sampleNearest(volume, [-11.1, 5, 7]), null);
  assert.equal(sampleNearest(volume, [-10, 5, 8.6]), null);
});

test("window and level", () => {
  const w = { window: 80, level: 40 };
  assert.equal(grey(0, w), 0);
  assert.equal(grey(40, w), 127.5);
  assert.equal(grey(80, w), 255);
  assert.equal(grey(-500, w), 0);
  assert.equal(grey(3000, w), 255);
});
