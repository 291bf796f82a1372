// A small case: a head of spheres with a plan, as the gateway serves it.
import type { Vec3 } from "../../src/geometry/vector.ts";

const kSize = 80;
const kSpacing_mm = 2.5;
const kSecond = 10; // voxels along each axis of the second image and of the labels
const kSecondSpacing_mm = 4;

export const kHash = "5".repeat(64);
export const kEntry: Vec3 = [30, 20, 75];
export const kTarget: Vec3 = [12, 5, 20];

export function fakeCase(): { json: object; files: Map<string, Buffer> } {
  const files = new Map<string, Buffer>();
  const url = (name: string) => `/case/${kHash}/${name}`;
  files.set(url("image"), Buffer.from(image().buffer));
  files.set(url("labels"), Buffer.from(leftHalf().buffer));
  files.set(url("image/second"), Buffer.alloc(kSecond ** 3, 200));
  // 40 mm around the centre, turned about z.
  const [c, s] = [Math.cos(0.3), Math.sin(0.3)];
  const corner = (-kSecondSpacing_mm * (kSecond - 1)) / 2;
  const row = (x: number, y: number, z: number) => [
    ...[x, y, z].map((value) => value * kSecondSpacing_mm),
    (x + y + z) * corner,
  ];
  const secondGrid = [...row(c, -s, 0), ...row(s, c, 0), ...row(0, 0, 1), 0, 0, 0, 1];
  const meshes = [
    ["scalp", "scalp", "#c9a58a", 0.2, [0, 0, 0], 88],
    ["brain", "brain", "#8fb8d8", 0.4, [0, 0, 0], 72],
    ["Vessel", "structure", "#ff4040", 1, [25, 5, 30], 8],
  ] as const;
  const offset = (-kSpacing_mm * (kSize - 1)) / 2;
  const tool = (name: string, role: string) => ({
    name,
    role,
    axis: [-1, 0, 0],
    normal: [0, 0, 1],
    tip_mm: [-150, 0, 0],
    markers_mm: [
      [0, 0, 0],
      [50, 30, 0],
      [55, -27, 0],
      [88, 6, 0],
    ],
  });
  // Carried by an arm.
  const guide = { ...tool("Guide", "pointer"), tip_mm: [-60, 0, 0], markers_mm: [] };
  const json = {
    hash: kHash,
    id: "spheres",
    side: "right",
    image: {
      url: url("image"),
      type: "int16",
      dims: [kSize, kSize, kSize],
      T_ras_voxel: [kSpacing_mm, 0, 0, offset, 0, kSpacing_mm, 0, offset, 0, 0, kSpacing_mm, offset, 0, 0, 0, 1],
      min: -1024,
      max: 1200,
      percentiles: [
        [1, -1024],
        [50, 20],
        [99, 900],
        [99.9, 1100],
      ],
    },
    labels: {
      url: url("labels"),
      type: "uint8",
      dims: [kSecond, kSecond, kSecond],
      T_ras_voxel: secondGrid,
      regions: [{ value: 7, name: "Left half", colour: "#00ff00" }],
    },
    images: [
      {
        name: "Second MR",
        T_image_source: [0, -1, 0, 5, 1, 0, 0, -3, 0, 0, 1, 2, 0, 0, 0, 1], // a quarter turn
        url: url("image/second"),
        type: "uint8",
        dims: [kSecond, kSecond, kSecond],
        T_ras_voxel: secondGrid,
        covariance: Array.from({ length: 36 }, (_, i) => (i % 7 === 0 ? (i < 21 ? 1e-4 : 0.03) : 0)),
        verdict: "ambiguous",
        accepted: "compared by eye",
        min: 200,
        max: 200,
        percentiles: [
          [1, 0],
          [50, 100],
          [99, 200],
          [99.9, 200],
        ],
      },
    ],
    meshes: meshes.map(([name, kind, colour, opacity, centre, radius]) => {
      const data = sphere(centre, radius);
      files.set(url(`mesh/${name}`), data);
      return {
        name,
        kind,
        colour,
        opacity,
        url: url(`mesh/${name}`),
        vertices: data.readUInt32LE(0),
        triangles: data.readUInt32LE(4),
      };
    }),
    trajectories: [{ name: "Plan", entry_mm: kEntry, target_mm: kTarget }],
    targets: [{ name: "Lesion", position_mm: kTarget }],
    fiducials: [
      { name: "F1", position_mm: [60, 60, 0] },
      { name: "F2", position_mm: [-60, 60, 0] },
    ],
    landmarks: [{ name: "Nasion", position_mm: [0, 88, 0] }],
    brain_landmarks: [],
    tools: [tool("Probe", "probe"), tool("Stylus", "pointer"), tool("Reference", "reference"), guide],
    limits: { max_check_mm: 3, max_target_tre_mm: 2 },
  };
  return { json, files };
}

function leftHalf(): Uint8Array {
  return new Uint8Array(kSecond ** 3).map((_, n) => (n % kSecond < kSecond / 2 ? 7 : 0));
}

// Skin, skull, brain with a pattern, and air.
function image(): Int16Array {
  const voxels = new Int16Array(kSize ** 3);
  for (let k = 0, n = 0; k < kSize; ++k) {
    for (let j = 0; j < kSize; ++j) {
      for (let i = 0; i < kSize; ++i, ++n) {
        const [x, y, z] = [i, j, k].map((index) => (index - (kSize - 1) / 2) * kSpacing_mm);
        const radius = Math.hypot(x, y, z);
        if (radius > 88) voxels[n] = -1000;
        else if (radius > 82) voxels[n] = 60;
        else if (radius > 74) voxels[n] = 1100;
        else voxels[n] = 30 + 14 * Math.sin(x / 6) * Math.cos(y / 7) * Math.sin(z / 8 + 1);
      }
    }
  }
  return voxels;
}

function sphere(centre: readonly [number, number, number], radius: number): Buffer {
  const rings = 24;
  const vertices: number[] = [];
  const triangles: number[] = [];
  for (let i = 0; i <= rings; ++i) {
    for (let j = 0; j < 2 * rings; ++j) {
      const [theta, phi] = [(Math.PI * i) / rings, (Math.PI * j) / rings];
      vertices.push(
        centre[0] + radius * Math.sin(theta) * Math.cos(phi),
        centre[1] + radius * Math.sin(theta) * Math.sin(phi),
        centre[2] + radius * Math.cos(theta),
      );
      if (i === rings) continue;
      const next = (j + 1) % (2 * rings);
      const [a, b, c, d] = [
        i * 2 * rings + j,
        i * 2 * rings + next,
        (i + 1) * 2 * rings + j,
        (i + 1) * 2 * rings + next,
      ];
      triangles.push(a, c, b, b, c, d);
    }
  }
  const head = Buffer.from(new Uint32Array([vertices.length / 3, triangles.length / 3]).buffer);
  return Buffer.concat([
    head,
    Buffer.from(new Float32Array(vertices).buffer),
    Buffer.from(new Uint32Array(triangles).buffer),
  ]);
}
