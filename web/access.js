import { Refusal, getSession, logIn, logOut, onRefused } from "./api.js";
import { byId, setText } from "./dom.js";

/** @import { Session } from "./types.js" */

/** What this browser may see and change; asks for a token where one is needed. */
export class Access {
  /** @param {{ onGranted: () => void, onLeft: () => void }} handlers */
  constructor({ onGranted, onLeft }) {
    this.onGranted = onGranted;
    this.onLeft = onLeft;
    /** @type {Session | null} */
    this.session = null;
    this.asking = false;
    /** Whoever closes the form wants to be left alone until the next button or refusal. */
    this.dismissed = false;
    this.dialog = byId("token-dialog", HTMLDialogElement);
    this.field = byId("token", HTMLInputElement);
    this.button = byId("session", HTMLButtonElement);
    this.dialog.addEventListener("close", () => {
      this.field.value = "";
    });
    this.dialog.addEventListener("cancel", () => {
      this.dismissed = true;
    });
    byId("token-cancel").addEventListener("click", () => {
      this.dismissed = true;
      this.dialog.close();
    });
    byId("token-form").addEventListener("submit", (event) => {
      event.preventDefault();
      void this.#send();
    });
    this.button.addEventListener("click", () => void this.#press());
    onRefused((change) => {
      // To see is asked for again and again; to change, only by somebody who has just pressed something.
      if (change) this.#ask("Changing something takes the control token.");
      else void this.refresh();
    });
  }

  /** Ask the daemon what may be done, and its reader for the token if that is nothing. */
  async refresh() {
    if (this.asking) return;
    this.asking = true;
    try {
      this.#take(await getSession());
    } catch {
      // It does not answer, which the connection's state tells.
    } finally {
      this.asking = false;
    }
    if (this.session?.token_needed && !this.session.scope && !this.dismissed) this.#ask("This doorcam takes a token.");
  }

  /** @param {Session} session */
  #take(session) {
    this.session = session;
    byId("exposed").hidden = !session.exposed;
    // A refused socket does not say why, and only looking is not refused.
    byId("foreign").hidden = !session.refusal;
    if (session.refusal) setText(byId("foreign"), `This address is not allowed: ${session.refusal}.`);
    this.button.hidden = !session.token_needed;
    setText(this.button, session.scope ? "Log out" : "Log in");
  }

  /** @param {string} why */
  #ask(why) {
    if (this.dialog.open) return;
    this.dismissed = false;
    setText(byId("token-why"), why);
    setText(byId("token-problem"), "");
    this.dialog.showModal();
  }

  async #send() {
    try {
      this.#take(await logIn(this.field.value.trim()));
      this.dialog.close();
      this.onGranted();
    } catch (error) {
      const why = error instanceof Refusal ? error.message : "the daemon does not answer";
      setText(byId("token-problem"), `Not logged in: ${why}.`);
      this.field.select();
    }
  }

  async #press() {
    if (!this.session?.scope) return this.#ask("This doorcam takes a token.");
    try {
      await logOut();
      // What is on the screen stays until the reader closes it, but nothing new comes.
      this.dismissed = true;
      this.onLeft();
    } finally {
      void this.refresh();
    }
  }
}
