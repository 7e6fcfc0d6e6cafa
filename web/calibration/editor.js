import { byId, resizeList, setText } from "../dom.js";
import { Handles, placeWords } from "./handles.js";
import { Loupe } from "./loupe.js";
import { MeasureForm } from "./form.js";
import { Outlines } from "../camera/outlines.js";
import { Stage } from "../camera/stage.js";
import { PointTable, yWords } from "./table.js";
import { errorsOf, summaryOf } from "./words.js";

/** @import { Pixel, PointCheck } from "../types.js" */
/** @import { Outcome } from "./checker.js" */
/** @import { Draft, DraftPoint } from "./points.js" */

// Words are said when the hand rests, not for every pixel on its way.
const REST_MS = 700;

/** A draft in all its forms: handles on the picture, numbers beside it, and what the check says. */
export class Editor {
  /** @param {() => void} onChange  the draft has been changed by its reader */
  constructor(onChange) {
    this.onChange = onChange;
    /** @type {Draft | null} */
    this.draft = null;
    this.editable = false;
    /** @type {Outcome | null} */
    this.outcome = null;
    /** @type {ReturnType<typeof setTimeout> | undefined} */
    this.speaking = undefined;

    const image = byId("cal-image", HTMLCanvasElement);
    this.stage = new Stage(byId("cal-viewport"), byId("cal-sheet"), () => {
      this.#showOverlay();
      this.loupe?.refresh();
    });
    const remove = (/** @type {DraftPoint} */ point) => this.#remove(point);
    const move = (/** @type {DraftPoint} */ point, /** @type {Pixel} */ pixel) => {
      this.draft?.place(point, pixel);
      this.#changed();
    };
    this.loupe = new Loupe(byId("cal-loupe", HTMLCanvasElement), image, this.stage, move);
    this.overlay = new Outlines(/** @type {SVGSVGElement} */ (/** @type {unknown} */ (byId("cal-overlay"))), this.stage);
    this.handles = new Handles(byId("cal-handles"), this.stage, {
      onMove: move,
      onSelect: (point) => this.loupe.show(point, this.editable),
      onRemove: remove,
      onNudged: (point) => this.#say(`${this.draft?.nameOf(point)}, ${placeWords(point.pixel)}`),
    });
    this.table = new PointTable(byId("cal-points", HTMLTableElement), { onTyped: () => this.#changed(), onRemove: remove });
    this.form = new MeasureForm(() => this.#changed());

    byId("cal-add").addEventListener("click", () => this.#add());
    this.#listenForZoom();
  }

  /** By buttons and keys; the chosen point stays where it is. */
  #listenForZoom() {
    const step = (/** @type {-1 | 1} */ direction) => this.stage.step(direction, this.handles.selected?.pixel ?? null);
    /** @type {[string, string[], () => void][]} */
    const controls = [
      ["cal-zoom-in", ["+", "="], () => step(1)],
      ["cal-zoom-out", ["-"], () => step(-1)],
      ["cal-zoom-fit", ["0"], () => this.stage.fit()],
    ];
    for (const [id, keys, zoom] of controls) {
      byId(id).addEventListener("click", zoom);
      byId("cal-handles").addEventListener("keydown", (event) => {
        if (keys.includes(event.key) && !event.ctrlKey && !event.metaKey) zoom();
      });
    }
    // A press on a button would otherwise take the choice away from the point.
    byId("cal-zoom").addEventListener("mousedown", (event) => event.preventDefault());
  }

  /** @returns {string | null} a field that says nothing usable */
  get problem() {
    return this.form.problem ?? this.table.problem;
  }

  /**
   * @param {Draft | null} draft
   * @param {boolean} editable
   * @param {Outcome | null} outcome  what is known of it already
   */
  open(draft, editable, outcome) {
    this.draft = draft;
    this.editable = editable;
    this.outcome = outcome;
    byId("calibration-view").classList.toggle("read-only", !editable);
    byId("cal-fields", HTMLFieldSetElement).disabled = !editable;
    byId("cal-steps").hidden = draft === null;
    if (draft) this.stage.setSize(draft.size);
    this.refresh();
  }

  /** @param {Outcome} outcome */
  learn(outcome) {
    this.outcome = outcome;
    this.refresh();
    const said = [...errorsOf(outcome), "check" in outcome ? summaryOf(outcome.check) : ""];
    this.#say(said.join(" ").trim());
  }

  /** The camera has sent a picture. */
  pictured() {
    this.loupe.refresh();
  }

  refresh() {
    const { draft, outcome } = this;
    if (!draft) {
      this.handles.show(null, false, () => null);
      this.#showOverlay();
      return;
    }
    const residualOf = (/** @type {DraftPoint} */ point) => this.#residualOf(point);
    this.handles.show(draft, this.editable, residualOf);
    this.table.show(draft, residualOf);
    this.form.show(draft);
    this.#showOverlay();
    this.loupe.refresh();
    setText(byId("cal-points-problem"), this.table.problem ?? "");
    setText(byId("cal-frame"), yWords(draft));
    const guessed = draft.points.some((point) => !point.placed);
    const found = outcome && "check" in outcome ? summaryOf(outcome.check) : "";
    setText(byId("cal-summary"), guessed ? "The dashed points are where this page has guessed: drag them to where they belong." : found);
    const errors = errorsOf(outcome);
    const list = byId("cal-errors");
    list.hidden = errors.length === 0;
    resizeList(list, errors.length, () => document.createElement("li"));
    errors.forEach((error, row) => setText(list.children[row], error));
    this.#markSteps(draft, outcome);
  }

  #showOverlay() {
    const { draft, outcome } = this;
    const check = outcome && "check" in outcome ? outcome.check : null;
    this.overlay.show(draft, check);
    const drawn = check?.error && check.points.some(({ residual_px }) => Math.hypot(...residual_px) >= 0.005);
    const words = byId("cal-residuals");
    words.hidden = !drawn;
    const { enlargement } = this.overlay;
    setText(words, `Residuals are drawn ${enlargement === 1 ? "" : `${enlargement} times `}as long as they are.`);
  }

  /**
   * @param {DraftPoint} point
   * @returns {PointCheck | null}
   */
  #residualOf(point) {
    const { draft, outcome } = this;
    if (!draft || !outcome || !("check" in outcome)) return null;
    const { points, error } = outcome.check;
    // Of four points every fit is exact: their residuals say nothing.
    if (points.length !== draft.points.length || !error || error.noise_px === null) return null;
    return points[draft.points.indexOf(point)];
  }

  /**
   * @param {Draft} draft
   * @param {Outcome | null} outcome
   */
  #markSteps(draft, outcome) {
    const placed = draft.points.map((point) => point.placed);
    const done = {
      door: draft.door.width_m !== null && draft.door.wall_thickness_m !== null && !this.form.problem,
      corners: placed.slice(0, 2).every(Boolean),
      marks: placed.slice(2).every(Boolean),
      check: placed.every(Boolean) && outcome !== null && "check" in outcome && outcome.check.ok,
    };
    for (const [step, is] of Object.entries(done)) byId(`cal-step-${step}`).classList.toggle("done", is);
  }

  #add() {
    const { draft } = this;
    if (!draft || !this.editable) return;
    const point = draft.add();
    this.#changed();
    this.handles.focus(point);
  }

  /** @param {DraftPoint} point */
  #remove(point) {
    const { draft } = this;
    if (!draft || !this.editable || !draft.mayRemove(point)) return;
    const name = draft.nameOf(point);
    draft.remove(point);
    this.#changed();
    // The focus was on what is gone.
    byId("cal-add").focus();
    this.#say(`${name} removed`);
  }

  #changed() {
    this.refresh();
    this.onChange();
  }

  /** @param {string} words */
  #say(words) {
    clearTimeout(this.speaking);
    this.speaking = setTimeout(() => setText(byId("cal-spoken"), words), REST_MS);
  }
}
