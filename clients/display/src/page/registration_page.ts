// Registration: fiducials with residual and leave-one-out, the traced skin, and what to touch next.
import { norm, sub } from "../geometry/vector.ts";
import { CaptureKind, RegistrationStatus } from "../state/constants.ts";
import { figure, registrationText } from "../state/text.ts";
import { coverageOf, kRegions, leastCovered } from "../view/coverage.ts";
import { isSurface } from "../view/scene.ts";
import type { PageContext, Part } from "./context.ts";
import { fill, h, setText, table } from "./dom.ts";

export class RegistrationPage implements Part {
  private readonly status = h("p", { class: "lead" });
  private readonly next = h("p", { class: "next" });
  private readonly fiducials = h("div");
  private readonly skin = h("div");
  private readonly numbers = h("p", { class: "small" });
  readonly element = h(
    "section",
    { class: "page", id: "registration-page" },
    h("h2", {}, "Registration"),
    this.status,
    this.next,
    h("h3", {}, "Fiducials"),
    this.fiducials,
    h("h3", {}, "Traced skin"),
    this.skin,
    this.numbers,
  );

  update(context: PageContext): void {
    const { store, scene, data } = context;
    const registration = store.all("registration")[0];
    const status = registration?.status;
    const placed = status === RegistrationStatus.CANDIDATE || status === RegistrationStatus.ACCEPTED;
    setText(this.status, registration ? registrationText(registration.status) : "Nothing registered yet");
    setText(
      this.next,
      (!placed && registration?.text) || (status === RegistrationStatus.ACCEPTED ? "" : nextTouch(context)),
    );
    const revision = `${store.revision("fiducial")} ${store.revision("capture")} ${data.hash}`;
    fill(this.fiducials, revision, () => [this.fiducialTable(context)]);
    fill(this.skin, skinKey(scene), () => coverageRows(context));
    const consistency = registration
      ? `FRE ${figure(registration.fre_mm, 2, "mm")} (expected ${figure(registration.fre_expected_mm, 2, "mm")}): a consistency, not an accuracy. ` +
        `Skin ${figure(registration.surface_rms_mm, 2, "mm")} RMS of ${registration.surface_samples} points.` +
        (placed && registration.text ? ` The estimate: ${registration.text}.` : "")
      : "";
    setText(this.numbers, consistency);
  }

  private fiducialTable({ store, data }: PageContext): HTMLElement {
    const touched = new Set(
      store
        .all("capture")
        .filter((c) => c.kind === CaptureKind.FIDUCIAL_TOUCH)
        .map((c) => c.point),
    );
    const reports = data.fiducials.map((f) => store.get("fiducial", f.name));
    const rows = data.fiducials.map((f, i) => [
      f.name,
      reports[i] || touched.has(f.name) ? "touched" : "–",
      figure(reports[i]?.norm_mm ?? Number.NaN, 2),
      figure(reports[i]?.leave_one_out_mm ?? Number.NaN, 2),
    ]);
    const columns = [
      { title: "" },
      { title: "" },
      { title: "residual mm", number: true },
      { title: "leave-one-out", number: true },
    ];
    return table(columns, rows, (r) => (reports[r]?.suspect === 1 ? "bad" : ""));
  }
}

// The next fiducial that was not touched, then the skin with the fewest points. Where skin comes first, as from an arm
// with a range sensor, no fiducial is asked for.
function nextTouch({ store, data, scene }: PageContext): string {
  const touched = new Set(store.all("capture").map((c) => c.point));
  const isTouched = (f: { name: string }) => touched.has(f.name) || store.get("fiducial", f.name) !== null;
  const skin = scene.captures.filter(isSurface);
  const skinFirst = skin.length + scene.unplaced.length > 0 && !data.fiducials.some(isTouched);
  const next = skinFirst ? undefined : data.fiducials.find((f) => !isTouched(f));
  if (next) return `Touch fiducial ${next.name}.`;
  const region = leastCovered(coverageOf(skin.map((c) => sub(c.position, centreOf(data)))));
  return region ? `The skin ${region} has the fewest points.` : "";
}

const skinKey = (scene: PageContext["scene"]): string =>
  `${scene.placedBy} ${scene.unplaced.length} ${scene.captures.length} ${scene.captures.at(-1)?.distance_mm}`;

function coverageRows({ scene, data }: PageContext): HTMLElement[] {
  const surface = scene.captures.filter(isSurface);
  const counts = coverageOf(surface.map((c) => sub(c.position, centreOf(data))));
  const most = Math.max(1, ...Object.values(counts));
  const bars = kRegions.map((region) => {
    const bar = h("meter", { min: 0, max: most, value: counts[region] });
    return h(
      "div",
      { class: "bar" },
      h("span", {}, region),
      bar,
      h("span", { class: "number" }, String(counts[region])),
    );
  });
  const distances = surface.map((c) => c.distance_mm).filter(Number.isFinite);
  const mean = (values: number[]) => values.reduce((sum, d) => sum + d, 0) / Math.max(values.length, 1);
  const rms = Math.sqrt(mean(distances.map((d) => d * d)));
  const most_mm = Math.max(...distances.map(Math.abs));
  const text = distances.length
    ? `Distance from the skin: ${figure(rms, 2, "mm")} RMS, mean ${figure(mean(distances), 2, "mm")} (+ is outside), ` +
      `at most ${figure(most_mm, 2, "mm")}`
    : "";
  return [...bars, h("p", { class: "small" }, text || unplacedText(scene))];
}

const unplacedText = ({ unplaced, reference }: PageContext["scene"]): string =>
  unplaced.length > 0 ? `${unplaced.length} points in ${reference}: not registered to the image yet` : "";

// Middle of the scalp's vertices, else of the fiducials.
const centres = new Map<string, readonly [number, number, number]>();
function centreOf(data: PageContext["data"]): readonly [number, number, number] {
  let centre = centres.get(data.hash);
  if (!centre) {
    const v = data.meshes.find((m) => m.kind === "scalp")?.mesh.vertices_mm ?? new Float32Array(3);
    const sum = [0, 0, 0];
    for (let i = 0; i < v.length; i += 3) for (let d = 0; d < 3; ++d) sum[d] += v[i + d];
    centre = [sum[0] / (v.length / 3), sum[1] / (v.length / 3), sum[2] / (v.length / 3)];
    if (!(norm(centre) < 1e6)) centre = [0, 0, 0];
    centres.set(data.hash, centre);
  }
  return centre;
}
