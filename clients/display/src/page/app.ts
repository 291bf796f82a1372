// The page: receives states, and draws them while they may be drawn.
import { type CaseData, kNoCase, loadCase } from "../state/case_data.ts";
import type { LocalTime } from "../state/clock.ts";
import { kStep_ms } from "../state/clock.ts";
import { CaseState } from "../state/constants.ts";
import { type Cover, coverOf } from "../state/cover.ts";
import type { Frame } from "../state/frame.ts";
import { localTime, StateLink } from "../state/link.ts";
import { Store } from "../state/store.ts";
import { figure } from "../state/text.ts";
import { remaining_ms } from "../state/validity.ts";
import { deformedSurface } from "../view/brain_surface.ts";
import { Captures } from "../view/captures.ts";
import { Display } from "../view/display.ts";
import { type DragTool, Interaction } from "../view/interaction.ts";
import { type ScannerSlice, ScannerSlices } from "../view/scanner_slice.ts";
import { type Scene, sceneOf } from "../view/scene.ts";
import { TipTrace } from "../view/tip_trace.ts";
import { ViewState } from "../view/view_state.ts";
import { Alarms } from "./alarms.ts";
import { BrainPage } from "./brain_page.ts";
import { CameraPage } from "./camera_page.ts";
import type { CaselessPart, Part } from "./context.ts";
import { CoverView } from "./cover_view.ts";
import { h, setClass } from "./dom.ts";
import { DrawTimes, drawTime } from "./draw_times.ts";
import { Figures } from "./figures.ts";
import { HealthPage } from "./health_page.ts";
import { PanelMenus } from "./panel_menus.ts";
import { RegistrationPage } from "./registration_page.ts";
import { ScannerPage } from "./scanner_page.ts";
import { save, screenshotOf } from "./screenshot.ts";
import { ToolBar } from "./tool_bar.ts";
import { TopBar } from "./top_bar.ts";
import { VerificationPage } from "./verification_page.ts";

const kWatch_ms = 100;
const kAsleep_ms = 1000; // by which the wall clock has left the page's timer: the computer slept
const kRetryCase_ms = 2000;

type Tab = { readonly name: string } & (
  | { readonly needsCase: true; readonly part: Part }
  | { readonly needsCase: false; readonly part: CaselessPart }
);

export class App {
  readonly store = new Store();
  readonly view = new ViewState();
  private readonly scannerView = new ViewState(); // without a case
  readonly display = new Display(() => this.changed());
  readonly times = new DrawTimes();
  readonly link: StateLink;
  scene: Scene | null = null;
  cover: Cover | null = null;
  draws = 0; // so far
  bare = false; // the panels show only images: what the benchmark compares with
  private data: CaseData | null = null;
  private loading = "";
  private failure = "";
  private awake = true;
  private linkWritten_ms = Number.NaN;
  private frameRequest = 0;
  private expiry: ReturnType<typeof setTimeout> | undefined;
  private arrived: { frame: Frame; at_ms: number } | null = null;
  private readonly captures = new Captures();
  private readonly trace = new TipTrace();
  private readonly slices = new ScannerSlices();
  private slice: ScannerSlice | null = null;
  private readonly interaction: Interaction;
  private readonly topBar = new TopBar();
  private readonly toolBar: ToolBar;
  private readonly menus: PanelMenus;
  private readonly coverView = new CoverView();
  private readonly pictureCover = new CoverView(); // over the picture alone
  private readonly alarms = new Alarms();
  private readonly figures = new Figures();
  private readonly brain = new BrainPage(() => this.changed());
  private readonly tabs: readonly Tab[];
  private readonly noCase = h("section", { class: "page" }, h("p", { class: "lead" }, "Shown with a case."));
  private tab = 0;
  private readonly side = h("div", { class: "side-panel" });

  constructor(root: HTMLElement) {
    const url = new URL("/state", location.href);
    url.protocol = url.protocol === "https:" ? "wss:" : "ws:";
    this.link = new StateLink(url.href, {
      frame: (frame, first) => this.take(frame, first),
      failed: (text) => {
        this.failure = text;
        this.changed();
      },
    });
    this.interaction = new Interaction(this.display.element, this.interactionHost());
    this.toolBar = new ToolBar(this.toolBarHost());
    this.menus = new PanelMenus(this.view, this.display, () => this.changed());
    this.tabs = [
      { name: "Guide", needsCase: true, part: this.figures },
      { name: "Register", needsCase: true, part: new RegistrationPage() },
      { name: "Verify", needsCase: true, part: new VerificationPage() },
      { name: "Brain", needsCase: true, part: this.brain },
      { name: "Camera", needsCase: false, part: new CameraPage() },
      { name: "Scanner", needsCase: false, part: new ScannerPage() },
      { name: "System", needsCase: false, part: new HealthPage(this.link, () => this.times.summary()) },
    ];
    this.build(root);
    this.display.setCase(kNoCase);
    document.addEventListener("visibilitychange", () => this.visibilityChanged());
    document.addEventListener("pointerdown", () => this.alarms.tone.unlock());
    document.addEventListener("keydown", () => this.alarms.tone.unlock());
    setInterval(() => this.watch(), kWatch_ms);
    this.visibilityChanged();
  }

  // Something may look different: draw soon.
  changed(): void {
    if (this.frameRequest || document.hidden) return;
    this.frameRequest = requestAnimationFrame(() => {
      this.frameRequest = 0;
      this.draw();
    });
  }

  private build(root: HTMLElement): void {
    const buttons = this.tabs.map(({ name }, i) =>
      h("button", { type: "button", role: "tab", click: () => this.select(i) }, name),
    );
    const picture = h("main", { class: "main" }, this.toolBar.element, this.display.element, this.pictureCover.element);
    this.display.element.append(this.menus.element);
    const panel = h(
      "div",
      { class: "right" },
      h("nav", { class: "tabs", role: "tablist" }, ...buttons),
      this.side,
      this.alarms.element,
    );
    root.append(this.topBar.element, h("div", { class: "body" }, picture, panel), this.coverView.element);
    this.select(0);
  }

  private select(index: number): void {
    this.tab = index;
    this.showTab();
    document.querySelectorAll(".tabs button").forEach((button, i) => {
      setClass(button as HTMLElement, "on", i === index);
    });
    this.link.requestField(this.tabs[index].name === "Brain");
    this.changed();
  }

  private showTab(): void {
    const tab = this.tabs[this.tab];
    const element = tab.needsCase && (this.cover || !this.data) ? this.noCase : tab.part.element;
    if (this.side.firstChild !== element) this.side.replaceChildren(element);
  }

  private take(frame: Frame, first: boolean): void {
    if (first) this.store.clear();
    this.failure = "";
    this.store.apply(frame);
    if (frame.records.some((r) => r.name === "link")) this.linkWritten_ms = frame.written_ms;
    this.arrived = { frame, at_ms: this.link.now_ms() };
    // After an interruption only what was measured and received since then counts.
    if (!this.awake && !document.hidden && Number.isFinite(this.link.now_ms())) this.awake = true;
    this.followCase();
    if (document.hidden) this.link.acknowledge();
    else this.changed();
  }

  private followCase(): void {
    const record = this.store.all("case")[0];
    const hash = record?.state === CaseState.COMPLETE ? record.hash : "";
    if (this.data && this.data.hash !== hash) this.setCase(null);
    if (!hash || this.data?.hash === hash || this.loading === hash) return;
    this.loading = hash;
    loadCase()
      .then((data) => {
        if (this.loading === data.hash) this.setCase(data);
      })
      .catch((error: Error) => {
        this.failure = `The case could not be loaded: ${error.message}.`;
        this.changed();
        setTimeout(() => {
          this.failure = "";
          this.followCase();
        }, kRetryCase_ms);
      })
      .finally(() => {
        this.loading = "";
      });
  }

  private setCase(data: CaseData | null): void {
    this.data = data;
    if (data) this.view.reset(data);
    this.captures.setCase(data);
    this.trace.clear();
    try {
      this.display.setCase(data ?? kNoCase);
    } catch (error) {
      this.failure = `The image cannot be drawn: ${(error as Error).message}.`;
    }
    this.topBar.setPatient("");
    if (data) this.fetchPatient();
    this.changed();
  }

  // Only on the daemon's own host: elsewhere the gateway does not have it.
  private fetchPatient(): void {
    fetch("/patient")
      .then(async (response) => {
        if (!response.ok) return;
        const { name, id, birth_date } = (await response.json()) as Record<string, string>;
        this.topBar.setPatient([name, birth_date && `* ${birth_date}`, id].filter(Boolean).join("  "));
      })
      .catch(() => {}); // the name stays away
  }

  private visibilityChanged(): void {
    if (document.hidden) {
      this.awake = false;
      this.showCover(localTime()); // now: no frame is drawn while hidden, and the first one after must be covered
      this.scene = null;
      this.display.blank();
      return;
    }
    if (!this.awake) this.link.remeasure();
    this.changed();
  }

  private watch(): void {
    const step_ms = Math.abs(this.link.clock.step_ms(localTime()));
    if (step_ms > kAsleep_ms) {
      this.awake = false;
      this.link.remeasure();
    } else if (step_ms > kStep_ms) this.link.ping();
    const before = this.cover;
    const covered = this.showCover(localTime());
    this.topBar.update(this.store, this.data);
    if (covered !== (before !== null)) this.changed();
  }

  private showCover(now: LocalTime): boolean {
    this.cover = coverOf({
      now,
      gateway_ms: this.link.clock.at(now),
      owedSince: this.link.owedSince,
      hidden: document.hidden,
      contextLost: this.display.contextLost,
      awake: this.awake,
      link: this.store.all("link")[0] ?? null,
      linkWritten_ms: this.linkWritten_ms,
      caseRecord: this.store.all("case")[0] ?? null,
      caseLoaded: this.data !== null,
      scannerSlice: this.slice !== null,
      failure: this.failure,
    });
    const { cover } = this;
    this.coverView.show(cover?.pictureOnly ? null : cover);
    this.pictureCover.show(cover?.pictureOnly ? cover : null);
    this.showTab();
    return this.cover !== null;
  }

  private draw(): void {
    ++this.draws;
    const now = localTime();
    this.toolBar.update(this.data);
    const gateway_ms = this.link.clock.at(now);
    const wanted = this.data ? this.view.panels.some((panel) => panel.kind === "scanner") : this.hasScanner;
    this.link.requestSlices(wanted);
    this.slice = this.slices.update(this.store, gateway_ms);
    if (this.showCover(now)) {
      this.scene = null;
      this.display.blank();
      if (this.cover?.pictureOnly) this.updateCaseless(gateway_ms);
      this.link.acknowledge();
      return;
    }
    this.drawStates(this.data ?? kNoCase, gateway_ms);
    this.link.acknowledge();
  }

  private get hasScanner(): boolean {
    return this.store.all("scanner").length > 0;
  }

  private updateCaseless(gateway_ms: number): void {
    const context = { store: this.store, data: null, gateway_ms };
    const tab = this.tabs[this.tab];
    if (!tab.needsCase) tab.part.update(context);
    this.alarms.update(context);
  }

  private get shownView(): ViewState {
    return this.data ? this.view : this.scannerView;
  }

  private drawStates(data: CaseData, gateway_ms: number): void {
    const { store, slice, shownView: view } = this;
    if (slice && !this.data) view.showScanner(slice.volume);
    const captures = this.captures.update(store);
    view.scannerPlane = slice?.plane ?? null;
    const scene = sceneOf({ data, store, gateway_ms, captures, trace: this.trace, slice });
    this.scene = scene;
    view.track(scene.followed);
    this.brain.collect(store, scene);
    this.showDeformed(data);
    this.display.draw({ view, scene, pending: this.interaction.pending, bare: this.bare });
    const context = { store, data, scene, view, gateway_ms };
    const tab = this.tabs[this.tab];
    if (this.data || !tab.needsCase) tab.part.update(context);
    this.alarms.update(context);
    this.menus.element.hidden = !this.data;
    this.menus.update();
    this.finishDraw(gateway_ms, scene);
  }

  private finishDraw(began_ms: number, scene: Scene): void {
    const arrived = this.arrived;
    this.arrived = null;
    if (arrived) {
      this.display.finish();
      const moments = { frame: arrived.frame, arrived_ms: arrived.at_ms, began_ms, ended_ms: this.link.now_ms() };
      this.times.add(drawTime(moments, scene.followedTool?.shown.state ?? null, performance.now()));
    }
    clearTimeout(this.expiry);
    const left = scene.tools.map((t) => remaining_ms(t.shown.state, this.link.now_ms()));
    if (left.length > 0) this.expiry = setTimeout(() => this.changed(), Math.max(0, Math.min(...left)) + 1);
  }

  private showDeformed(data: CaseData): void {
    const mesh = data.meshes.find((m) => m.kind === "tissue")?.mesh;
    const field = this.store.field;
    const { colour } = this.brain;
    if (this.tabs[this.tab].name !== "Brain" || !mesh || !field || colour === "plain") {
      this.display.setDeformed(null);
      return;
    }
    const key = `${this.store.revision("field")} ${colour}`;
    if (this.display.deformedKey === key) return;
    const surface = deformedSurface(mesh, field, colour);
    this.brain.setScale(surface?.largest ?? Number.NaN);
    this.display.setDeformed(surface && { ...surface, key });
  }

  private interactionHost() {
    const app = this;
    return {
      get view() {
        return app.shownView;
      },
      get followed() {
        return app.scene?.followed ?? { line: null, trajectory: null };
      },
      get windowRange() {
        const full = app.data?.presets.at(-1);
        return full?.window ?? 1;
      },
      rectOf: (index: number) => app.display.rectOf(index),
      penOf: (index: number) => (app.scene ? app.display.penOf(index, app.shownView, app.scene) : null),
      changed: () => app.changed(),
    };
  }

  private toolBarHost() {
    const app = this;
    return {
      view: app.view,
      get tool() {
        return app.interaction.tool;
      },
      set tool(tool: DragTool) {
        app.interaction.tool = tool;
      },
      get sound() {
        return app.alarms.tone.on;
      },
      set sound(on: boolean) {
        app.alarms.tone.on = on;
      },
      get audible() {
        return app.alarms.tone.ready;
      },
      changed: () => app.changed(),
      screenshot: () => void app.takeScreenshot(),
    };
  }

  private async takeScreenshot(): Promise<void> {
    const { scene, data, store, cover } = this;
    if (!scene || !data || cover) return;
    this.figures.update({ store, data, scene, view: this.view, gateway_ms: this.link.now_ms() });
    const lines = [
      ...this.figures.lines,
      ...this.store.all("alarm").map((a) => `Alarm: ${a.alarm} ${a.subject}: ${a.text}`),
    ];
    const { display, view } = this;
    const title = `${this.topBar.text}  ·  ${view.convention}  ·  W ${figure(view.window.window, 0)} L ${figure(view.window.level, 0)}`;
    const blob = await screenshotOf({ display, view, title, lines });
    save(blob, `bregma ${new Date().toISOString().replaceAll(":", "-")}.png`);
  }
}
