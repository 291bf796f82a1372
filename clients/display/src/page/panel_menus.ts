// The menu in the corner of each panel: which plane it shows, and larger or smaller.
import type { Display } from "../view/display.ts";
import { kPanelNames, type PanelKind, type ViewState } from "../view/view_state.ts";
import { h } from "./dom.ts";

export class PanelMenus {
  readonly element = h("div", { class: "menus" });
  private readonly menus: HTMLElement[];
  private readonly selects: HTMLSelectElement[];

  constructor(
    private readonly view: ViewState,
    private readonly display: Display,
    changed: () => void,
  ) {
    this.selects = [0, 1, 2, 3].map((index) => {
      const change = (e: Event) => {
        view.setKind(index, (e.target as HTMLSelectElement).value as PanelKind);
        changed();
      };
      const options = Object.entries(kPanelNames).map(([kind, name]) => h("option", { value: kind }, name));
      return h("select", { "aria-label": `plane of panel ${index + 1}`, change }, ...options);
    });
    this.menus = this.selects.map((select) => h("div", { class: "menu" }, select));
    this.element.append(...this.menus);
  }

  update(): void {
    this.menus.forEach((menu, index) => {
      const rect = this.display.rectOf(index);
      menu.hidden = rect === null;
      if (!rect) return;
      menu.style.left = `${rect.x + 6}px`;
      menu.style.top = `${rect.y + 6}px`;
      if (this.selects[index].value !== this.view.panels[index].kind)
        this.selects[index].value = this.view.panels[index].kind;
    });
  }
}
