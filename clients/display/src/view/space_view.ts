// The 3-D panel: surfaces, planes, plan and tool in space.

import { lettersOf } from "../geometry/letters.ts";
import { centredAt, kOrthogonalKinds, type Plane } from "../geometry/planes.ts";
import { add, negate, scale, unit, type Vec3 } from "../geometry/vector.ts";
import { towardsViewer, viewMatrix } from "../render/camera.ts";
import { LayerCache } from "../render/layer_cache.ts";
import { type Colour, type MeshBuffer, MeshRenderer, type MeshStyle } from "../render/mesh_renderer.ts";
import type { SliceLayers, SliceRenderer, Viewport } from "../render/slice_renderer.ts";
import { type CaseData, type CaseMesh, colourOf } from "../state/case_data.ts";
import { kColours } from "./colours.ts";
import type { Rect } from "./layout.ts";
import { Pen } from "./pen.ts";
import { type Scene, type SceneArm, type SceneTool, tipAhead } from "./scene.ts";
import { drawSkinPoints } from "./skin_points.ts";
import { drawNotVerified, drawPlanNames } from "./slice_overlay.ts";
import type { ViewState } from "./view_state.ts";

const kShaft_mm = 140;
const kShaftRadius_mm = 1.2;
const kFlangeRadius_mm = 5;

const rgb = (css: string): Colour => colourOf(css);

export class SpaceView {
  private readonly meshes: MeshRenderer;
  private readonly layers: LayerCache;
  private buffers = new Map<CaseMesh, MeshBuffer>();
  private air = Number.NEGATIVE_INFINITY;
  private deformed: { buffer: MeshBuffer; key: string } | null = null;

  constructor(
    private readonly gl: WebGL2RenderingContext,
    private readonly slices: SliceRenderer,
  ) {
    this.meshes = new MeshRenderer(gl);
    this.layers = new LayerCache(gl);
  }

  setCase(data: CaseData | null): void {
    this.air = data?.air ?? Number.NEGATIVE_INFINITY;
    for (const buffer of this.buffers.values()) this.meshes.delete(buffer);
    this.layers.clear();
    this.setDeformed(null);
    this.buffers = new Map((data?.meshes ?? []).map((m) => [m, this.meshes.upload(m.mesh)]));
  }

  get deformedKey(): string {
    return this.deformed?.key ?? "";
  }

  // The deformed surface of the brain with a colour per vertex; null: none. `key` states what it shows.
  setDeformed(surface: { mesh: CaseMesh["mesh"]; colours: Float32Array; key: string } | null): void {
    if (this.deformed) this.meshes.delete(this.deformed.buffer);
    this.deformed = surface ? { buffer: this.meshes.upload(surface.mesh, surface.colours), key: surface.key } : null;
  }

  draw(layers: SliceLayers, view: ViewState, scene: Scene, rect: Rect, viewport: Viewport, bare: boolean): void {
    const { gl } = this;
    const camera = view.cameraFor(rect);
    const matrix = viewMatrix(camera, rect.width, rect.height);
    gl.viewport(viewport.x, viewport.y, viewport.width, viewport.height);
    gl.enable(gl.DEPTH_TEST);
    gl.clear(gl.DEPTH_BUFFER_BIT | gl.COLOR_BUFFER_BIT);
    if (view.opacities.planes) this.drawPlanes(layers, view, scene, matrix);
    if (!bare) {
      this.meshes.begin(matrix, towardsViewer(camera));
      this.drawPlans(scene);
      for (const tool of scene.tools) {
        const arm = scene.arms.find((one) => one.tool === tool);
        this.drawTool(tool, arm?.flange ?? tipAhead(tool, -kShaft_mm));
        if (arm) this.drawArm(arm);
      }
      this.drawMarks(view, scene, camera.mm_per_pixel);
      this.drawSurfaces(view, matrix, towardsViewer(camera), viewport);
    }
    gl.disable(gl.DEPTH_TEST);
  }

  private drawPlanes(layers: SliceLayers, view: ViewState, scene: Scene, matrix: Float32Array): void {
    const half = view.extent_mm / 2;
    for (const kind of kOrthogonalKinds) {
      const plane = view.planeOf(kind, scene.followed) as Plane;
      this.slices.drawInSpace(layers, centredAt(plane, view.imageCentre), [half, half], matrix, this.air);
    }
  }

  private drawPlans(scene: Scene): void {
    const style = { colour: rgb(kColours.plan), opacity: 1 };
    for (const plan of scene.plans) {
      this.meshes.drawRod(plan.entry_mm, plan.target_mm, 0.6, style);
      this.meshes.drawBall(plan.entry_mm, 1.6, style);
      this.meshes.drawBall(plan.target_mm, 2.4, style);
    }
    const { predicted, extrapolated } = scene.target ?? { predicted: null, extrapolated: false };
    const opacity = extrapolated ? 0.5 : 1;
    if (predicted) this.meshes.drawBall(predicted, 2.4, { colour: rgb(kColours.predicted), opacity });
  }

  // Flange and base are known, the joints between them are not: a thin line, which is no link of the arm.
  private drawArm({ tool, flange, base }: SceneArm): void {
    const style = { colour: rgb(toolColour(tool)), opacity: 1 };
    this.meshes.drawBall(flange, kFlangeRadius_mm, style);
    if (!base) return;
    this.meshes.drawBall(base, 2 * kFlangeRadius_mm, style);
    this.meshes.drawRod(base, flange, kShaftRadius_mm / 2, style);
  }

  private drawTool(tool: SceneTool, from: Vec3): void {
    const style = { colour: rgb(toolColour(tool)), opacity: 1 };
    this.meshes.drawRod(from, tool.tip, kShaftRadius_mm, style);
    const { axes, semi_axes_mm } = tool.region_95;
    const axis = (i: number): Vec3 => scale([axes[3 * i], axes[3 * i + 1], axes[3 * i + 2]], semi_axes_mm[i]);
    this.meshes.drawEllipsoid(tool.tip, [axis(0), axis(1), axis(2)], { ...style, opacity: 0.45 });
  }

  private drawMarks(view: ViewState, scene: Scene, mm_per_pixel: number): void {
    for (const f of scene.fiducials) {
      this.meshes.drawBall(f.position, 2, {
        colour: rgb(f.suspect ? kColours.suspect : kColours.fiducial),
        opacity: 1,
      });
    }
    // The cross hair, in the colours of its planes.
    const [a, c, s] = kOrthogonalKinds.map((kind) => view.planeOf(kind, scene.followed) as Plane);
    const rod = (direction: Vec3, colour: string) => {
      const reach = view.extent_mm / 2;
      const style = { colour: rgb(colour), opacity: 1 };
      const at = (mm: number) => add(view.cursor, scale(direction, mm));
      this.meshes.drawRod(at(-reach), at(reach), Math.max(0.3, 0.7 * mm_per_pixel), style); // never between two pixels
    };
    const normal = (p: Plane): Vec3 =>
      unit([
        p.right[1] * p.up[2] - p.right[2] * p.up[1],
        p.right[2] * p.up[0] - p.right[0] * p.up[2],
        p.right[0] * p.up[1] - p.right[1] * p.up[0],
      ]);
    rod(normal(a), kColours.axial);
    rod(normal(c), kColours.coronal);
    rod(normal(s), kColours.sagittal);
  }

  // Structures first, then what encloses them. A layer per kind: a translucent surface shows its nearest side only.
  private drawSurfaces(view: ViewState, matrix: Float32Array, viewer: Vec3, viewport: Viewport): void {
    const of = (kind: CaseMesh["kind"]) => [...this.buffers].filter(([mesh]) => mesh.kind === kind);
    const layer = (name: CaseMesh["kind"], opacity: number, colourOfMesh: (mesh: CaseMesh) => Colour) => {
      if (opacity <= 0.01) return;
      const solid = opacity >= 0.99;
      this.layers.draw(name, `${matrix} ${opacity}`, viewport, !solid, () => {
        this.meshes.begin(matrix, viewer);
        for (const [mesh, buffer] of of(name)) {
          this.drawSurface(buffer, { colour: colourOfMesh(mesh), opacity: solid ? 1 : opacity });
        }
      });
    };
    layer("structure", view.opacities.structure, (mesh) => mesh.colour);
    if (this.deformed) {
      this.meshes.begin(matrix, viewer);
      this.meshes.draw(this.deformed.buffer, { colour: [1, 1, 1], opacity: 1, ownColours: true });
    } else {
      layer("brain", view.opacities.brain, () => rgb(kColours.brain));
    }
    layer("scalp", view.opacities.scalp, () => rgb(kColours.scalp));
  }

  private drawSurface(buffer: MeshBuffer, style: MeshStyle): void {
    const { gl } = this;
    gl.enable(gl.CULL_FACE); // the far side of a closed surface adds nothing and costs as much as the near one
    this.meshes.draw(buffer, style);
    gl.disable(gl.CULL_FACE);
  }
}

const toolColour = (tool: SceneTool): string => (tool.verified ? kColours.live : kColours.unverified);

function drawArmNames(pen: Pen, { tool, flange, base }: SceneArm): void {
  const name = (text: string, at: Vec3) => {
    const p = pen.pixel(at);
    pen.text(text, p.x + 10, p.y - 10, 13, toolColour(tool));
  };
  name("flange", flange);
  if (base) name("arm’s base", base);
}

// Title, captured points and the patient's axes over the 3-D panel.
export function drawSpaceOverlay(
  c: CanvasRenderingContext2D,
  rect: Rect,
  view: ViewState,
  scene: Scene,
  bare: boolean,
): void {
  const camera = view.cameraFor(rect);
  const pen = new Pen(c, rect, camera, camera.mm_per_pixel);
  c.save();
  c.beginPath();
  c.rect(rect.x, rect.y, rect.width, rect.height);
  c.clip();
  if (!bare) {
    const viewer = towardsViewer(camera);
    drawSkinPoints(pen, scene);
    for (const arm of scene.arms) drawArmNames(pen, arm);
    drawPlanNames(pen, scene);
    const tool = scene.followedTool;
    if (tool && view.trace) pen.polyline(scene.trace, toolColour(tool), 1.5);
    drawAxes(pen, viewer);
  }
  pen.text("3-D", rect.x + 10, rect.y + 18, 16, kColours.letter, "left", true);
  drawNotVerified(pen, scene);
  c.restore();
}

// R, A and S at a corner, as far as they do not point to the viewer.
function drawAxes(pen: Pen, viewer: Vec3): void {
  const { rect, mm_per_pixel } = pen;
  const centre: Vec3 = pen.image(rect.x + rect.width - 52, rect.y + rect.height - 52);
  for (const axis of [
    [1, 0, 0],
    [0, 1, 0],
    [0, 0, 1],
  ] as Vec3[]) {
    const facing = axis[0] * viewer[0] + axis[1] * viewer[1] + axis[2] * viewer[2];
    const direction = facing < -0.3 ? negate(axis) : axis;
    const end = add(centre, scale(direction, 30 * mm_per_pixel));
    pen.line(centre, end, kColours.muted, 1.5);
    const beyond = pen.pixel(add(centre, scale(direction, 42 * mm_per_pixel)));
    if (Math.abs(facing) < 0.9) pen.text(lettersOf(direction), beyond.x, beyond.y, 16, kColours.letter, "center", true);
  }
}
