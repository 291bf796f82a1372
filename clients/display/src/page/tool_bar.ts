// The viewer's choices: layout, what a drag does, window presets, planes, convention, what is drawn.
import type { CaseData } from "../state/case_data.ts";
import type { DragTool } from "../view/interaction.ts";
import type { Layout } from "../view/layout.ts";
import type { ViewState } from "../view/view_state.ts";
import { fill, h, setClass, setText } from "./dom.ts";

export interface ToolBarHost {
  readonly view: ViewState;
  tool: DragTool;
  sound: boolean;
  readonly audible: boolean; // false: the browser waits for a click before it plays sound
  changed(): void;
  screenshot(): void;
}

const kLayouts: readonly [Layout, string][] = [
  ["2x2", "2×2"],
  ["1+3", "1+3"],
  ["one", "1"],
];
const kTools: readonly [DragTool, string][] = [
  ["window", "Window"],
  ["step", "Slice"],
  ["pan", "Pan"],
  ["measure", "Measure"],
];

export class ToolBar {
  private readonly updates: (() => void)[] = [];
  private readonly presets = h("span", { class: "group", role: "group", "aria-label": "Window presets" });
  private readonly values = h("span", { class: "values" });
  private readonly second = h("span", { class: "group second" });
  readonly element: HTMLElement;

  constructor(private readonly host: ToolBarHost) {
    const { view } = host;
    const layouts = kLayouts.map(([layout, text]) =>
      this.button(
        text,
        () => view.layout === layout,
        () => {
          view.layout = layout;
        },
        `layout ${text}`,
      ),
    );
    const tools = kTools.map(([tool, text]) =>
      this.button(
        text,
        () => host.tool === tool,
        () => {
          host.tool = tool;
        },
      ),
    );
    this.element = h(
      "nav",
      { class: "tools" },
      group(...layouts),
      group(
        ...tools,
        this.button(
          "Clear",
          () => false,
          () => {
            view.measurements = [];
          },
          "clear measurements",
        ),
      ),
      this.presets,
      this.values,
      group(
        this.button(
          "Follow tip",
          () => view.follow,
          () => {
            view.follow = !view.follow;
          },
        ),
        this.button(
          "Straighten",
          () => view.oblique,
          () => view.straighten(),
        ),
      ),
      group(this.conventionButton()),
      group(
        this.button(
          "Labels",
          () => view.labels,
          () => {
            view.labels = !view.labels;
          },
        ),
        this.button(
          "Trace",
          () => view.trace,
          () => {
            view.trace = !view.trace;
          },
        ),
      ),
      this.second,
      this.surfaces(),
      group(
        this.soundButton(),
        this.button(
          "Screenshot",
          () => false,
          () => host.screenshot(),
        ),
      ),
    );
  }

  update(data: CaseData | null): void {
    const { view } = this.host;
    fill(this.presets, data?.hash ?? "", () =>
      (data?.presets ?? []).map((preset) =>
        h(
          "button",
          {
            type: "button",
            click: () =>
              this.act(() => {
                view.window = preset;
              }),
          },
          preset.name,
        ),
      ),
    );
    fill(this.second, data?.hash ?? "", () => this.secondImage(data));
    const digits = view.window.window < 10 ? 2 : 0;
    setText(this.values, `W ${view.window.window.toFixed(digits)}  L ${view.window.level.toFixed(digits)}`);
    for (const update of this.updates) update();
  }

  private act(action: () => void): void {
    action();
    this.host.changed();
  }

  private button(text: string, pressed: () => boolean, action: () => void, label = text): HTMLButtonElement {
    const button = h("button", { type: "button", "aria-label": label, click: () => this.act(action) }, text);
    this.updates.push(() => setClass(button, "on", pressed()));
    return button;
  }

  // The click that lets the browser play sound, on the button itself, does not end the sound.
  private soundButton(): HTMLButtonElement {
    const { host } = this;
    let heard = false;
    const button = this.button(
      "Sound",
      () => host.sound && host.audible,
      () => {
        host.sound = !(host.sound && heard);
      },
    );
    for (const before of ["pointerdown", "keydown"]) {
      button.addEventListener(before, () => {
        heard = host.audible;
      });
    }
    this.updates.push(() => setText(button, host.sound && !host.audible ? "Sound: click" : "Sound"));
    return button;
  }

  // States the convention, and changes it.
  private conventionButton(): HTMLButtonElement {
    const { view } = this.host;
    const next = () => (view.convention === "radiological" ? "neurological" : "radiological");
    const button = h("button", {
      type: "button",
      class: "convention",
      "aria-label": "convention",
      click: () => this.act(() => view.setConvention(next())),
    });
    this.updates.push(() => setText(button, view.convention === "radiological" ? "Radiological" : "Neurological"));
    return button;
  }

  // Which image is blended over the case's, and how much of it; nothing if the case has no other.
  private secondImage(data: CaseData | null): HTMLElement[] {
    if (!data || data.images.length === 0) return [];
    const { view } = this.host;
    const choose = (e: Event) =>
      this.act(() => {
        view.second = (e.target as HTMLSelectElement).value;
      });
    const blend = (e: Event) =>
      this.act(() => {
        view.secondBlend = Number((e.target as HTMLInputElement).value);
      });
    const options = ["", ...data.images.map((image) => image.name)].map((name) =>
      h("option", { value: name }, name || "one image"),
    );
    const select = h("select", { "aria-label": "second image", change: choose }, ...options);
    select.value = view.second;
    const share = h("input", {
      type: "range",
      min: 0,
      max: 1,
      step: 0.02,
      value: view.secondBlend,
      input: blend,
      "aria-label": "blend of both",
    });
    return [select, share];
  }

  private surfaces(): HTMLElement {
    const { view } = this.host;
    const slider = (name: "scalp" | "brain" | "structure", text: string) => {
      const change = (e: Event) =>
        this.act(() => {
          view.opacities[name] = Number((e.target as HTMLInputElement).value);
        });
      const input = h("input", {
        type: "range",
        min: 0,
        max: 1,
        step: 0.02,
        value: view.opacities[name],
        input: change,
        "aria-label": `opacity of ${text}`,
      });
      return h("label", {}, text, input);
    };
    const planes = (e: Event) =>
      this.act(() => {
        view.opacities.planes = (e.target as HTMLInputElement).checked;
      });
    return h(
      "details",
      { class: "surfaces" },
      h("summary", {}, "3-D"),
      h(
        "div",
        {},
        slider("scalp", "Scalp"),
        slider("brain", "Brain"),
        slider("structure", "Structures"),
        h("label", {}, "Planes", h("input", { type: "checkbox", checked: true, change: planes })),
      ),
    );
  }
}

const group = (...children: HTMLElement[]): HTMLElement => h("span", { class: "group" }, ...children);
