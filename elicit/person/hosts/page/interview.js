// What a person sees of an interview, drawn into any element. elicit/person/interview.py says what the messages and the
// replies are. It imports nothing, and all that comes from a problem is set as text, never read as HTML.

const UNTOUCHED = 250; // ms after something is drawn in which no button works: what still comes was meant for the last
const SLOW = 400; // ms after which a wait is put into words
const AGAIN = 1000; // ms between two looks at what is computed beside a question
const KEYS = { ArrowLeft: "a", a: "a", ArrowRight: "b", b: "b", ArrowDown: "equal", "?": "cannot tell" };
// from the worst level to the best; orange and blue, which nearly everybody tells apart
const COLOURS = [[127, 39, 4], [217, 95, 14], [254, 196, 79], [198, 219, 239], [107, 174, 214], [8, 81, 156]];
const NUMBERS = ["no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten"];

// Draw an interview into the element `root`; `send(message)` promises the reply, or rejects with an Error whose message
// says what the person can do. What may differ between hosts: `keys`, the target that hears the keyboard; `later`, how
// to go on another day; `titled(text)`, told where the person is. Returns a function that takes all of it away.
export function mount(root, send, options = {}) {
  const {
    keys = root,
    later = "To go on, start the same command again. It goes on where you are now.",
    titled = () => {},
  } = options;
  let screen = null; // the last one drawn
  let view = "stage"; // or "answers", or "pause", which are looked at beside it
  let listed = null; // the reply to "answers"
  let beside = null; // the reply to "outlook" for the question on the screen
  let drawn = false; // whether anything was
  let busy = false;
  let failed = null; // what is to be tried again
  let turn = 0; // counts what was done, to tell that a reply comes too late
  let following = 0;
  let untouched = 0; // a timer

  const banner = part("div", "banner", { role: "alert" });
  const brand = part("div", "brand");
  const progress = part("div", "place"); // .progress has a style in notebooks
  const note = part("p", "note", { role: "status" });
  const waiting = part("p", "waiting", { role: "status" });
  const body = part("div", "body");
  const saved = part("span", "saved", { role: "status" });
  const nav = part("div", "nav");
  const sheet = part("div", "sheet", { tabindex: "-1" }, [
    part("div", "head", {}, [brand, progress]), banner, part("div", "middle", {}, [waiting, note, body]),
    part("div", "foot", {}, [saved, nav]),
  ]);
  hide(banner);
  root.classList.add("elicit");
  root.replaceChildren(sheet);

  // ---- what is said to the host

  // One thing at a time: `job` is done while the buttons wait, and what it changed is drawn, unless it returns STAYS.
  // A failure is told, with a button that does it again; `lost` says what is not done.
  async function act(job, lost = "This cannot be shown yet.") {
    if (busy) return;
    busy = true;
    turn += 1;
    clearTimeout(untouched);
    const before = document.activeElement;
    sheet.setAttribute("aria-busy", "true");
    enable(false);
    const slow = setTimeout(() => say(waiting, "Working out what comes next ..."), SLOW);
    let stays = false;
    try {
      stays = (await job()) === STAYS;
      failed = null;
    } catch (error) {
      failed = { job, lost, why: error.message };
    }
    clearTimeout(slow);
    say(waiting, "");
    busy = false;
    sheet.removeAttribute("aria-busy");
    if (failed) return complain();
    hide(banner);
    if (!stays) return draw(true);
    enable(true);
    before?.focus({ preventScroll: true });
  }

  const show = (message, lost) =>
    act(async () => {
      screen = await send(message);
      view = "stage";
    }, lost);

  const answer = (choice, words) =>
    screen.stage === "practice"
      ? show({ do: "practised", choice })
      : show({ do: "answer", id: screen.question.id, choice }, `Your answer (${words}) has not been saved yet.`);

  const undo = () => show({ do: "undo", id: screen.last.id }, "The last answer has not been taken back yet.");

  const withdraw = (id) =>
    act(async () => {
      screen = await send({ do: "withdraw", id });
      if (view === "answers") listed = await send({ do: "answers" });
    }, "This answer has not been taken back yet.");

  const list = () =>
    act(async () => {
      listed = await send({ do: "answers" });
      view = "answers";
    });

  const keep = () =>
    act(async () => {
      const report = await send({ do: "report" });
      const link = part("a", "", { href: URL.createObjectURL(new Blob([report.html], { type: "text/html" })) });
      link.download = report.name;
      link.click();
      setTimeout(() => URL.revokeObjectURL(link.href), 60000);
      return STAYS;
    });

  function look(at) {
    view = at;
    draw(true);
  }

  // What another window or the phone did meanwhile is drawn when the person comes back to this one.
  async function catchUp() {
    if (document.visibilityState === "hidden" || busy || failed || !screen) return;
    const then = turn;
    const now = await send({ do: "state" }).catch(() => null); // what does not answer is told when it matters
    if (!now || then !== turn || same(now, screen)) return;
    screen = now;
    if (view === "answers") list();
    else draw(root.contains(document.activeElement));
  }

  // What is computed beside a question, until all of it is there.
  async function follow() {
    const mine = ++following;
    const id = screen.question.id;
    for (;;) {
      const reply = await send({ do: "outlook", id }).catch(() => null);
      if (mine !== following || !reply) return;
      beside = reply;
      drawBeside();
      if (reply.ready) return;
      await new Promise((done) => setTimeout(done, AGAIN));
      if (mine !== following) return;
    }
  }

  // ---- what is drawn

  function draw(moved) {
    following += 1;
    brand.replaceChildren(part("b", "", {}, [screen.title || "Your judgement"]));
    if (screen.title) brand.append(part("span", "soft", {}, ["your judgement"]));
    const views = { stage: { practice: question, question, end }[screen.stage], answers, pause };
    const [at, ...parts] = views[view]();
    const heading = part("h1", "heading", { tabindex: "-1" }, at.heading);
    body.replaceChildren(heading, ...parts);
    progress.replaceChildren(part("b", "", {}, [at.name]), part("span", "", {}, [at.more]));
    titled(screen.title ? `${at.name} - ${screen.title}` : at.name);
    say(note, view === "pause" ? "" : screen.note || "");
    foot();
    enable(false);
    clearTimeout(untouched);
    untouched = setTimeout(() => enable(true), UNTOUCHED);
    beside = null;
    if (view === "stage" && screen.stage === "question") follow();
    // a screen reader reads the new heading; what is only opened does not take the place of what else is there
    if (moved && drawn) {
      heading.focus({ preventScroll: true });
      if (sheet.getBoundingClientRect().top < 0) sheet.scrollIntoView();
    }
    drawn = true;
  }

  function foot() {
    const n = screen.answered;
    const words = n ? `${n} ${n === 1 ? "answer" : "answers"} saved on this computer` : "Nothing answered yet";
    const tick = part("span", "tick", { "aria-hidden": "true" }, ["✓ "]);
    if (!saved.textContent.endsWith(words)) saved.replaceChildren(...(n ? [tick, words] : [words]));
    nav.replaceChildren(
      ...(view === "answers" ? [] : [button("link", "Your answers", list)]),
      ...(view === "pause" ? [] : [button("link", "Pause, go on later", () => look("pause"))]),
    );
  }

  function question() {
    const asked = screen.question;
    const practice = screen.stage === "practice";
    const name = practice ? "Practice" : `Question ${asked.number}`;
    const parts = asked.sentences.map((sentence) => part("p", "same", {}, [sentence]));
    if (practice) parts.unshift(part("p", "practice", {}, [part("b", "", {}, ["To practise. "]), TRY, legend(asked)]));
    if (screen.preamble) parts.push(part("p", "soft preamble", {}, [screen.preamble]));
    parts.push(sides(asked), others());
    if (!practice) {
      const why = part("details", "why", {}, [part("summary", "", {}, ["Why this question?"])]);
      parts.push(why);
    }
    const at = { heading: [part("span", "unseen", {}, [`${name}. `]), asked.heading], name, more: practice ? NOT : "" };
    return [at, ...parts];
  }

  function sides(asked) {
    const counts = asked.rows.flatMap((row) => [row.a, row.b]);
    const most = Math.max(1, ...counts);
    const pair = part("div", "pair");
    if (most > 20 && asked.icons) pair.classList.add("small");
    if (asked.rows.length > 7) pair.classList.add("many");
    pair.style.setProperty("--digits", thousands(most).length);
    for (const [i, side] of ["a", "b"].entries()) {
      const words = `${asked.sides[i]} is better`;
      const heading = part("h2", "", {}, [asked.sides[i]]);
      const rows = part("ul", "rows", {}, asked.rows.map((row) => level(asked, row, row[side], most)));
      const [key, shortcut] = i ? ["→", "ArrowRight B"] : ["←", "ArrowLeft A"];
      const pick = button("pick", words, () => answer(side, words), key, shortcut);
      pick.dataset.choice = side;
      const card = part("section", "card", { "aria-label": asked.sides[i] }, [heading, rows, pick]);
      card.style.gridRow = `span ${asked.rows.length + 2}`; // so that the rows of both sides are aligned
      rows.style.gridRow = `span ${Math.max(1, asked.rows.length)}`;
      pair.append(card);
    }
    return pair;
  }

  function others() {
    const equal = button("alt", "Equally good", () => answer("equal", "equally good"), "↓", "ArrowDown");
    const unsure = button("alt", "I cannot tell", () => answer("cannot tell", "cannot tell"), "?", "?");
    equal.dataset.choice = "equal";
    unsure.dataset.choice = "cannot tell";
    return part("div", "mid", { role: "group", "aria-label": "Other answers" }, [equal, unsure, undoing()]);
  }

  function undoing() {
    const back = button("undo", "Undo last answer", undo, "U", "U Control+Z");
    if (screen.last) {
      back.title = `Takes back: ${screen.last.sentence}`;
      back.setAttribute("aria-description", back.title);
    } else {
      back.dataset.never = "yes";
      back.disabled = true;
    }
    return back;
  }

  // What came in beside the question: how many more there are, and why this one.
  function drawBeside() {
    if (view !== "stage") return;
    progress.lastChild.textContent = toCome(beside.to_come);
    const why = body.querySelector(".why");
    why?.querySelectorAll("p").forEach((p) => p.remove());
    const said = beside.why.length || beside.ready ? beside.why : ["Still being worked out ..."];
    const lines = said.length ? said : ["Its answer tells most about what is still open."];
    why?.append(...lines.map((line) => part("p", "", {}, [line])));
  }

  function end() {
    const { open, scale, certainty, statements, counts, conflicts } = screen.end;
    const among = [
      [counts.equal, "equally good"], [counts["cannot tell"], "cannot tell"], [counts.unused, "not used"],
      [counts.withdrawn, "more taken back"],
    ];
    const some = among.filter(([n]) => n).map(([n, words]) => `${n} ${words}`);
    const said = `${counts.answered} ${counts.answered === 1 ? "answer" : "answers"}`;
    const parts = [part("p", "soft", {}, [some.length ? `${said} (${some.join(", ")}).` : `${said}.`])];
    if (open) parts.push(part("p", "same", {}, [open]));
    parts.push(...conflicts.map(conflict));
    if (scale.length) parts.push(worth(scale, certainty));
    if (statements.length) parts.push(section("What follows from your answers", lines(statements)));
    const save = button("pick", "Keep a report", keep);
    parts.push(part("div", "mid", {}, [save, undoing()]));
    return [{ heading: ["There are no more questions. Thank you!"], name: "Finished", more: "" }, ...parts];
  }

  // Answers that do not go together, each of which can be taken back.
  function conflict(entries) {
    const items = entries.map(({ id, sentence }) =>
      part("li", "", {}, [part("span", "", {}, [sentence]), back(id, sentence)]),
    );
    const n = NUMBERS[entries.length] ?? entries.length;
    const [which, mends] =
      entries.length === 1
        ? ["This answer does not go with the order of the levels: would you change it?", "The other answers stay."]
        : [`These ${n} answers do not go together: which would you change?`, MENDS];
    const hint = part("p", "soft", {}, [mends]);
    return part("section", "conflict", {}, [part("h2", "", {}, [which]), part("ul", "list", {}, items), hint]);
  }

  function back(id, sentence) {
    const take = button("back", "Take back", () => withdraw(id));
    take.setAttribute("aria-label", `Take back: ${sentence}`);
    return take;
  }

  function answers() {
    const standing = new Map(listed.answers.filter((one) => !one.withdrawn).map((one) => [one.id, one]));
    const among = new Set(listed.conflicts.flat());
    const items = listed.answers.map((one) => {
      const tags = [];
      if (one.withdrawn) tags.push("taken back");
      else if (among.has(one.id)) tags.push("does not go together with others");
      if (!one.withdrawn && !one.used && !one.repeat) tags.push("not used");
      if (one.repeat) tags.push("asked again, to see how steady answers are");
      const words = part("span", "words", {}, [part(one.withdrawn ? "s" : "span", "", {}, [one.sentence])]);
      words.append(...tags.map((tag) => part("span", "tag", {}, [tag])));
      const when = one.time && new Date(one.time).toLocaleString(undefined, WHEN);
      if (when) words.append(part("time", "soft", { datetime: one.time }, [when]));
      return part("li", one.withdrawn ? "gone" : "", {}, one.withdrawn ? [words] : [words, back(one.id, one.sentence)]);
    });
    const conflicts = listed.conflicts.map((ids) => conflict(ids.map((id) => standing.get(id)).filter(Boolean)));
    const none = part("p", "", {}, ["There are none yet."]);
    const list = part("ul", "list", {}, items.reverse());
    const parts = [...conflicts, items.length ? list : none, returning()];
    return [{ heading: ["Your answers"], name: "Your answers", more: "" }, ...parts];
  }

  function pause() {
    const parts = [part("p", "", {}, ["Everything is saved on this computer. You can close this window now."])];
    parts.push(part("p", "", {}, [later]), returning());
    return [{ heading: ["Paused"], name: "Paused", more: "" }, ...parts];
  }

  function returning() {
    const words = screen.stage === "end" ? "Back to what came out" : "Back to the question";
    return part("div", "mid", {}, [button("pick", words, () => look("stage"))]);
  }

  function complain() {
    const { job, lost, why } = failed;
    const again = button("alt", "Try again", () => act(job, lost));
    banner.replaceChildren(part("p", "", {}, [part("b", "", {}, [lost]), ` ${why}`]), again);
    banner.hidden = false;
    say(note, "");
    again.disabled = false;
    again.focus({ preventScroll: true });
  }

  function say(where, words) {
    if (where.textContent !== words) where.textContent = words;
  }

  function enable(yes) {
    for (const one of sheet.querySelectorAll("button")) one.disabled = !yes || Boolean(one.dataset.never);
    if (!yes && !busy) for (const one of nav.querySelectorAll("button")) one.disabled = false;
  }

  // ---- what the person does

  function pressed(event) {
    const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    const writing = event.target.closest?.("input, textarea, select, [contenteditable]");
    if (event.repeat || event.altKey || event.defaultPrevented || writing || busy || failed || view !== "stage") return;
    const control = event.ctrlKey || event.metaKey;
    const undone = control ? key === "z" && !event.shiftKey : key === "u" && !event.shiftKey;
    const choice = control || (event.shiftKey && key !== "?") ? undefined : KEYS[key];
    const pushed = undone ? body.querySelector(".undo") : choice && body.querySelector(`[data-choice="${choice}"]`);
    if (!pushed) return;
    // where the answers are still below the edge, this key is for going there
    if (key === "ArrowDown" && pushed.getBoundingClientRect().bottom > window.innerHeight) return;
    event.preventDefault();
    event.stopPropagation();
    pushed.click();
  }

  keys.addEventListener("keydown", pressed);
  window.addEventListener("focus", catchUp);
  document.addEventListener("visibilitychange", catchUp);
  show({ do: "state" });
  return () => {
    following += 1;
    clearTimeout(untouched);
    keys.removeEventListener("keydown", pressed);
    window.removeEventListener("focus", catchUp);
    document.removeEventListener("visibilitychange", catchUp);
    root.replaceChildren();
  };
}

const TRY = "The answer to this first question is not kept.";
const NOT = "this one does not count";
const MENDS = "To take back any one of them would mend it. The others stay.";
const STAYS = "stays"; // returned by what changes nothing on the screen
const WHEN = { dateStyle: "medium", timeStyle: "short" };

// An element with a class, attributes, and what is in it: elements, or strings, which stay text.
function part(tag, name, attributes = {}, inside = []) {
  const made = document.createElement(tag);
  if (name) made.className = name;
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.append(...inside);
  return made;
}

function button(name, words, done, key, shortcut) {
  const hint = key ? [part("kbd", "", { "aria-hidden": "true" }, [key])] : [];
  const made = part("button", name, { type: "button" }, [...hint, words]);
  if (shortcut) made.setAttribute("aria-keyshortcuts", shortcut);
  made.addEventListener("click", done);
  return made;
}

function section(title, inside) {
  return part("section", "part", {}, [part("h2", "", {}, [title]), ...inside]);
}

// Lines as paragraphs; those that are indented as a list under the one before.
function lines(texts) {
  const made = [];
  for (const text of texts) {
    if (!text.startsWith("  ")) made.push(part("p", "", {}, [text]));
    else {
      if (made.at(-1)?.tagName !== "UL") made.push(part("ul", "plain"));
      made.at(-1).append(part("li", "", {}, [text.trim()]));
    }
  }
  return made;
}

function hide(element) {
  element.hidden = true;
  element.replaceChildren();
}

// A level on one side: how many, its name, and as many icons in fives, or a bar.
function level(asked, row, n, most) {
  const picture = part("span", "icons", { "aria-hidden": "true" });
  const colour = colourOf(row.level, asked.levels);
  if (asked.icons) {
    const all = Array.from({ length: n }, () => icon(row.level, asked.levels, colour));
    while (all.length) picture.append(part("span", "five", {}, all.splice(0, 5)));
  } else {
    const bar = part("span", "bar");
    bar.style.width = `${(100 * n) / most}%`;
    bar.style.backgroundColor = colour;
    if (n) picture.append(bar);
  }
  const words = [part("span", "n", {}, [thousands(n)]), " ", part("span", "label", {}, [row.label]), picture];
  return part("li", n ? "row" : "row none", {}, words);
}

const legend = (asked) =>
  asked.icons ? ` Each circle is one of the ${asked.unit}: ✓ is the best that can be, ✕ the worst.` : "";

function icon(level, levels, colour) {
  const mark = level === 0 ? "✕" : level === levels - 1 ? "✓" : "";
  const made = part("i", mark ? "icon marked" : "icon", {}, [mark]);
  made.style.backgroundColor = colour;
  return made;
}

function colourOf(level, levels) {
  const at = (level / Math.max(1, levels - 1)) * (COLOURS.length - 1);
  const low = Math.min(Math.floor(at), COLOURS.length - 2);
  return `rgb(${COLOURS[low].map((x, i) => Math.round(x + (at - low) * (COLOURS[low + 1][i] - x))).join(",")})`;
}

// What the levels are worth, as a table whose middle column is a picture.
function worth(scale, certainty) {
  const head = ["Level", null, "Best guess", "Range"].map((words) =>
    words ? part("th", "", { scope: "col" }, [words]) : part("td", "drawn", {}, [axis()]),
  );
  const rows = scale.map(({ label, value, low, high }, i) => {
    const range = low === high ? "fixed" : `${low} to ${high}`;
    return part("tr", "", {}, [
      part("th", "", { scope: "row" }, [label]),
      part("td", "drawn", {}, [interval(low, value, high, colourOf(scale.length - 1 - i, scale.length))]),
      part("td", "number", {}, [String(Math.round(value))]),
      part("td", "number", {}, [range]),
    ]);
  });
  const said =
    "From 0, the worst, to 100, the best: 60 is as good as 60 of 100 at the best level and 40 at the worst. " +
    "The dot is the best guess, the bar what is still open";
  const table = part("table", "worth", {}, [
    part("caption", "soft", {}, [`${said} (${certainty}).`]),
    part("thead", "", {}, [part("tr", "", {}, head)]),
    part("tbody", "", {}, rows),
  ]);
  return section("What the levels are worth to you", [table]);
}

function svg(tag, attributes, inside = []) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.append(...inside);
  return made;
}

function axis() {
  const marks = [0, 50, 100].map((x) => svg("text", { x: `${x}%`, y: 14, "text-anchor": "middle" }, [String(x)]));
  return svg("svg", { class: "axis", "aria-hidden": "true", focusable: "false" }, marks);
}

function interval(low, value, high, colour) {
  const marks = [0, 25, 50, 75, 100].map((x) => `${x}%`);
  const grid = marks.map((x) => svg("line", { class: "grid", x1: x, x2: x, y1: 0, y2: "100%" }));
  const [x, width] = [`${low}%`, `${high - low}%`];
  const bar = svg("rect", { class: "open", x, width, y: "30%", height: "40%", rx: 3, fill: colour });
  const dot = svg("circle", { class: "guess", cx: `${value}%`, cy: "50%", r: 6 });
  return svg("svg", { class: "interval", "aria-hidden": "true", focusable: "false" }, [...grid, bar, dot]);
}

function toCome(range) {
  if (!range) return "";
  const [least, most] = range;
  if (most === 0) return "the last one, as it looks now";
  if (least === most) return `about ${most} more`;
  return least === 0 ? `at most ${most} more, as it looks now` : `about ${least} to ${most} more`;
}

const thousands = (n) => n.toLocaleString("en-US");

function same(one, other) {
  const [a, b] = [one, other].map((s) => JSON.stringify([s.stage, s.question?.id, s.answered, s.last?.id]));
  return a === b;
}
