// The API's description for people: openapi.json as a page.

import { byId } from "./dom.js";

// Parts of that document, whose shape OpenAPI fixes.
/** @typedef {any} Schema */
/** @typedef {any} Answer */
/** @typedef {(Node | string)[]} Words */

/**
 * @param {string} name
 * @param {...(Node | string)} children
 */
function element(name, ...children) {
  const made = document.createElement(name);
  made.append(...children);
  return made;
}

/**
 * Paragraphs, with `code` in them.
 * @param {string} text
 */
function paragraphs(text) {
  return text.split("\n\n").map((part) => {
    const pieces = part.split("`").map((piece, k) => (k % 2 ? element("code", piece) : piece));
    return element("p", ...pieces);
  });
}

/**
 * What a value means; that of a key that may be null stands beside its type.
 * @param {Schema} schema
 * @returns {string}
 */
const meaning = (schema) => schema.description ?? schema.oneOf?.find((/** @type {Schema} */ part) => part.description)?.description ?? "";

/** @param {string} ref */
const named = (ref) => ref.slice(ref.lastIndexOf("/") + 1);

/**
 * What a value is, in words, with links to what it is made of.
 * @param {Schema} schema
 * @returns {Words}
 */
function kind(schema) {
  if (schema.$ref) {
    const link = document.createElement("a");
    link.href = `#${named(schema.$ref)}`;
    link.textContent = named(schema.$ref);
    return [link];
  }
  if (schema.enum) return [schema.enum.map((/** @type {unknown} */ value) => JSON.stringify(value)).join(" | ")];
  const parts = schema.oneOf ?? schema.allOf;
  if (parts) return parts.flatMap((/** @type {Schema} */ part, /** @type {number} */ k) => (k ? [schema.oneOf ? " | " : " + ", ...kind(part)] : kind(part)));
  if (schema.items) return ["list of ", ...kind(schema.items)];
  const fields = Object.keys(schema.properties ?? {});
  if (fields.length > 0) return [`{ ${fields.join(", ")} }`];
  return [[schema.type ?? "anything"].flat().join(" | ")];
}

/** @param {[string, Words][]} rows */
function table(rows) {
  return element("dl", ...rows.flatMap(([name, words]) => [element("dt", name), element("dd", ...words)]));
}

/**
 * @param {Answer} answer
 * @param {any} api
 * @returns {Words}
 */
function content(answer, api) {
  const whole = answer.$ref ? api.components.responses[named(answer.$ref)] ?? {} : answer;
  const types = Object.entries(/** @type {Record<string, any>} */ (whole.content ?? {}));
  const words = types.flatMap(([type, { schema }]) => [" ", element("code", type), " ", ...(schema ? kind(schema) : [])]);
  return [whole.description ?? "", ...words];
}

/**
 * @param {string} path
 * @param {string} method
 * @param {any} operation
 * @param {any} api
 */
function route(path, method, operation, api) {
  /** @type {[string, Words][]} */
  const rows = (operation.parameters ?? []).map((/** @type {any} */ p) => [p.name, [`${p.description ?? ""} (${p.in}, `, ...kind(p.schema), ")"]]);
  if (operation.requestBody) rows.push(["body", content(operation.requestBody, api)]);
  for (const [status, answer] of Object.entries(/** @type {Record<string, Answer>} */ (operation.responses))) rows.push([status, content(answer, api)]);
  const said = [operation.summary, operation.description].filter(Boolean).join("\n\n");
  return element("article", element("h3", `${method.toUpperCase()} ${path}`), ...paragraphs(said), table(rows));
}

/**
 * @param {string} name
 * @param {Schema} schema
 */
function shape(name, schema) {
  const parts = [schema, ...(schema.allOf ?? [])];
  /** @type {[string, Words][]} */
  const rows = parts.flatMap((/** @type {Schema} */ part) => Object.entries(/** @type {Record<string, Schema>} */ (part.properties ?? {}))).map(([key, property]) => {
    return [key, [...kind(property), element("br"), meaning(property)]];
  });
  const article = element("article", element("h3", name), ...paragraphs(schema.description ?? ""));
  article.id = name;
  article.append(rows.length > 0 ? table(rows) : element("p", ...kind(schema)));
  return article;
}

/** @param {any} api */
function show(api) {
  /** @type {Record<string, Record<string, any>>} */
  const paths = api.paths;
  const routes = Object.entries(paths).flatMap(([path, operations]) =>
    Object.entries(operations).map(([method, operation]) => ({ path, method, operation })),
  );
  const groups = api.tags.flatMap((/** @type {any} */ tag) => [
    element("h2", tag.name),
    element("p", tag.description),
    ...routes
      .filter(({ operation }) => operation.tags.includes(tag.name))
      .map(({ path, method, operation }) => route(path, method, operation, api)),
  ]);
  /** @type {Record<string, Schema>} */
  const schemas = api.components.schemas;
  const shapes = Object.entries(schemas).map(([name, schema]) => shape(name, schema));
  const head = [element("p", `Version ${api.info.version}`), ...paragraphs(api.info.description)];
  byId("reference").replaceChildren(...head, ...groups, element("h2", "Shapes"), ...shapes);
}

async function load() {
  try {
    const answer = await fetch("api/v1/openapi.json");
    if (answer.status === 401) throw new Error("a token is needed: the live map asks for it");
    if (!answer.ok) throw new Error(`doorcam answers ${answer.status}`);
    show(await answer.json());
    // The page was empty when the browser looked for the place that its address names.
    if (location.hash) document.getElementById(location.hash.slice(1))?.scrollIntoView();
  } catch (error) {
    const why = error instanceof TypeError ? "doorcam does not answer" : /** @type {Error} */ (error).message;
    byId("wait").textContent = `The description cannot be loaded: ${why}.`;
  }
}

void load();
