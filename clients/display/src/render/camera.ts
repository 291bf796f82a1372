// An orthographic camera that turns about a point: lengths in the picture are true, as in the other panels.
import { add, cross, dot, scale, turn, type Vec3 } from "../geometry/vector.ts";

export interface Camera {
  readonly centre: Vec3; // in the middle of the picture
  readonly right: Vec3;
  readonly up: Vec3;
  readonly mm_per_pixel: number;
}

export const towardsViewer = (camera: Camera): Vec3 => cross(camera.right, camera.up);

// Turned by a drag of the mouse, in radians about the picture's vertical and horizontal.
export function orbit(camera: Camera, horizontal_rad: number, vertical_rad: number): Camera {
  const up = turn(camera.up, camera.right, vertical_rad);
  const axis = up;
  return { ...camera, up, right: turn(camera.right, axis, horizontal_rad) };
}

export const panned = (camera: Camera, dx: number, dy: number): Camera => ({
  ...camera,
  centre: add(
    camera.centre,
    add(scale(camera.right, -dx * camera.mm_per_pixel), scale(camera.up, dy * camera.mm_per_pixel)),
  ),
});

const kDepth_mm = 1000; // before and behind the centre

// Column by column, for WebGL: Image to clip coordinates of a viewport.
export function viewMatrix(camera: Camera, width: number, height: number): Float32Array {
  const { centre, right, up, mm_per_pixel } = camera;
  const sx = 2 / (width * mm_per_pixel);
  const sy = 2 / (height * mm_per_pixel);
  const n = towardsViewer(camera);
  const sz = -1 / kDepth_mm;
  // prettier-ignore
  return new Float32Array([
    sx * right[0],
    sy * up[0],
    sz * n[0],
    0,
    sx * right[1],
    sy * up[1],
    sz * n[1],
    0,
    sx * right[2],
    sy * up[2],
    sz * n[2],
    0,
    -sx * dot(right, centre),
    -sy * dot(up, centre),
    -sz * dot(n, centre),
    1,
  ]);
}
