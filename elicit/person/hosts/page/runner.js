// The page of whoever runs a study: who has answered how much, links, agreement so far, and the end. The docstrings of
// elicit/person/study/study.py and elicit/person/hosts/study_app.py say what the messages and the replies are.

import { axis, button, colourOf, guessWords, interval, part, section, technical } from "./interview.js";
import { sender } from "./send.js";

const EVERY = 5000; // ms between two looks at where everybody is
const STOPPED =
  "The program does not answer. Start the study again with the same command, and open the address of your page that it " +
  "prints then. All answers are saved.";
const SHUT_OUT = "The program was restarted. Open the address of your page that it printed then.";
const WHEN = { dateStyle: "medium", timeStyle: "short" };

const send = sender(STOPPED, SHUT_OUT);
let state = null; // the reply to "state" that is drawn
let agreed = null; // the reply to "agreement" that is drawn
let counted = ""; // how many answers of each person that was about
let asking = false; // whether the end waits to be confirmed
let busy = false;

const banner = part("div", "banner", { role: "alert", hidden: "" });
const brand = part("div", "brand");
const place = part("div", "place");
const note = part("p", "note", { role: "status" });
const heading = part("h1", "", { tabindex: "-1" }, ["Study"]);
const top = part("div");
const people = part("ul", "people");
const agreement = part("div");
const ending = part("div");
const sheet = part("div", "sheet", {}, [
  part("div", "head", {}, [part("div", "wrap", {}, [brand, place]), part("div", "wrap", {}, [part("div", "meter")])]),
  banner,
  part("div", "middle", {}, [part("div", "wrap", {}, [note, heading, top, people, agreement, ending])]),
  part("div", "foot", {}, [part("div", "wrap", {}, ["Only you see this page. Nobody sees another person's answers."])]),
]);
const root = document.getElementById("runner");
root.classList.add("elicit");
root.replaceChildren(sheet);

// ---- what is asked of the program

async function ask(message, said = "") {
  busy = true;
  try {
    const reply = await send(message, (seconds) => say(`Getting ready: ${seconds} s so far. Links can be sent by then.`));
    banner.hidden = true;
    say(said);
    return reply;
  } catch (error) {
    banner.replaceChildren(part("p", "", {}, [error.message]), button("alt", "Try again", () => look(true)));
    banner.hidden = false;
    return null;
  } finally {
    busy = false;
  }
}

async function look(anyway = false) {
  if (busy || (document.visibilityState === "hidden" && !anyway)) return;
  const found = await ask({ do: "state" }, note.textContent);
  if (found) draw(found);
}

async function change(message, said) {
  const found = await ask(message, said);
  if (found) draw(found);
}

async function compare(count) {
  counted = count;
  const found = await send({ do: "agreement" }).catch(() => null);
  if (!found) counted = ""; // it is asked for again
  else if (JSON.stringify(found) !== JSON.stringify(agreed)) {
    agreed = found;
    agreement.replaceChildren(...agreeing(found));
  }
}

// ---- what is drawn

function draw(found) {
  const before = state;
  state = found;
  const total = found.people.reduce((sum, one) => sum + one.answered, 0);
  const count = JSON.stringify(found.people.map((one) => one.last));
  if (count !== counted) compare(count);
  if (JSON.stringify(before) === JSON.stringify(found)) return;
  const focused = document.activeElement?.dataset.key;
  brand.replaceChildren(part("b", "", {}, [found.title || "A study"]), part("span", "soft", {}, ["the study"]));
  document.title = found.title ? `Study - ${found.title}` : "Study";
  place.replaceChildren(part("b", "", {}, [many(total, "answer")]));
  heading.textContent = found.ended ? "The study has ended" : "Who has answered how much";
  top.replaceChildren(...introduction(found));
  people.replaceChildren(...found.people.map((one) => person(one, found.ended)));
  ending.replaceChildren(...closing(found));
  if (focused) sheet.querySelector(`[data-key="${CSS.escape(focused)}"]`)?.focus({ preventScroll: true });
}

function introduction({ ended }) {
  const said = ended
    ? "No more answers are taken. Each person sees their own result. To take answers again, stop the program and start it with the same command."
    : "Send each person the link with their name. A link lets in one browser, once. A new link shuts out the browser " +
      "that used the one before. After a restart of the program everybody needs a new link.";
  return [part("p", "soft", {}, [said])];
}

function person(one, ended) {
  const parts = [
    part("h2", "", {}, [one.who]),
    part("b", "", {}, [many(one.answered, "answer")]),
    part("span", one.settled ? "status good" : "soft", {}, [words(one)]),
  ];
  if (one.minutes) parts.push(part("span", "soft", {}, [`planned ${many(one.minutes, "minute")}`]));
  const when = one.last && new Date(one.last).toLocaleString(undefined, WHEN);
  if (when) parts.push(part("span", "soft small", {}, ["last answer ", part("time", "", { datetime: one.last }, [when])]));
  const inside = [part("div", "who", {}, parts)];
  if (!ended) inside.push(sharing(one));
  return part("li", "person", {}, [part("section", "panel", { "aria-label": one.who }, inside)]);
}

function words(one) {
  if (one.settled) return "✓ at the result, settled";
  return one.state === "at the result" ? "at the result, not settled" : one.state;
}

function sharing({ who, link, opened }) {
  const fresh = keyed(button("back", "New link", () => change({ do: "link", who }, `There is a new link for ${who}.`)), `new ${who}`);
  fresh.setAttribute("aria-label", `New link for ${who}`);
  if (!link) return part("div", "share", {}, [part("span", "soft small", {}, [opened ? "The link was opened." : ""]), fresh]);
  const field = keyed(part("input", "field", { type: "text", readonly: "", "aria-label": `Link for ${who}` }), `link ${who}`);
  field.value = link;
  field.addEventListener("focus", () => field.select());
  const copied = keyed(button("back", "Copy", () => copy(who, field)), `copy ${who}`);
  copied.setAttribute("aria-label", `Copy the link for ${who}`);
  return part("div", "share", {}, [field, copied, fresh]);
}

async function copy(who, field) {
  field.select();
  try {
    await navigator.clipboard.writeText(field.value);
    say(`The link for ${who} is copied.`);
  } catch {
    say(`The link for ${who} is selected: copy it with Ctrl+C.`);
  }
}

function agreeing({ few, levels, certainty, questions, groups, people: who }) {
  if (few) return [section("Agreement so far", [part("p", "soft", {}, [few])])];
  const said =
    "Each level's value to each person, from 0, the worst level, to 100, the best. The bar is the range, " +
    "and the dot is the best guess. A dashed bar is a wide range: its best guess, with a hollow dot, is not exact yet. “Not known yet” means that none of the person's answers narrows a range. " +
    `The ranges hold ${certainty}.`;
  const rows = levels.flatMap(({ label, each }, i) => [
    part("tr", "first", {}, [part("th", "level", { scope: "rowgroup", colspan: "3" }, [label])]),
    ...each.map((one) => {
      const range = one.low === one.high ? "fixed" : `${one.low} to ${one.high}`;
      const guess = `${guessWords(one)} (${range})`;
      const colour = colourOf(levels.length - 1 - i, levels.length);
      const cells = [
        part("th", "name", { scope: "row" }, [one.who]),
        part("td", "drawn", {}, [interval(one.low, one.value, one.high, colour, one.known, one.rough)]),
        part("td", "number", {}, [one.low === one.high ? String(one.low) : guess]),
      ];
      return part("tr", "", {}, cells);
    }),
  ]);
  const heads = [
    part("th", "name", { scope: "col" }, ["Person"]),
    part("td", "drawn", {}, [axis()]),
    part("th", "number", { scope: "col" }, ["Best guess (range)"]),
  ];
  const table = part("table", "each", {}, [
    part("caption", "soft", {}, [said]),
    part("thead", "", {}, [part("tr", "", {}, heads)]),
    part("tbody", "", {}, rows),
  ]);
  const parts = [section("Agreement so far", [part("div", "panel", {}, [table])])];
  const divides = questions.map(({ text, prefers }) =>
    part("li", "", {}, [
      part("span", "", {}, [text]),
      part("span", "soft small", {}, [`Chance that each prefers the first: ${prefers.map(([name, n]) => `${name} ${n}%`).join(", ")}.`]),
    ]),
  );
  if (divides.length) {
    parts.push(section("Questions that divide these people most", [
      part("p", "soft", {}, ["Talk about these first. The first in the list divides the most."]),
      part("ol", "dividing", {}, divides),
    ]));
  }
  parts.push(section("Groups", groups.map((line) => part("p", "", {}, [line]))));
  const missing = state.people.map((one) => one.who).filter((name) => !who.includes(name));
  if (missing.length) parts.push(part("p", "soft", {}, [`Not compared yet, because they gave no answer: ${missing.join(", ")}.`]));
  return parts;
}

function closing({ ended, report, facts }) {
  const parts = [];
  if (report) {
    parts.push(part("p", "", {}, ["This command makes the report, with tables of scales, plans or choices, and answers. It can be run at any time:"]));
    parts.push(part("p", "command", {}, [report]));
  }
  if (!ended && asking) {
    parts.push(part("p", "caution", {}, ["Nobody can answer any more after this. Answers so far are kept. Each person then sees their own result."]));
    parts.push(part("div", "mid closing", {}, [
      keyed(button("alt danger", "End the study now", finish), "end"),
      keyed(button("alt", "Keep it open", () => sure(false)), "open"),
    ]));
  } else if (!ended) {
    parts.push(part("div", "mid closing", {}, [keyed(button("alt", "End the study", () => sure(true)), "end")]));
  }
  return [section(ended ? "The report" : "The report and the end", parts), ...technical(facts)];
}

function sure(yes) {
  asking = yes;
  ending.replaceChildren(...closing(state));
  ending.querySelector(yes ? '[data-key="open"]' : '[data-key="end"]')?.focus();
}

async function finish() {
  await change({ do: "end" }, "The study has ended.");
  heading.focus();
  window.scrollTo(0, 0);
}

function keyed(element, key) {
  element.dataset.key = key;
  return element;
}

function say(words) {
  if (note.textContent !== words) note.textContent = words;
}

const many = (n, word) => `${n} ${n === 1 ? word : `${word}s`}`;

document.addEventListener("visibilitychange", () => look());
window.addEventListener("focus", () => look());
setInterval(look, EVERY);
look(true);
