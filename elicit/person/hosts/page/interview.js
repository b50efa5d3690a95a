// What a person sees of an interview, drawn into any element. docs/interview-messages.md says what the messages and the
// replies are. It imports nothing, and all that comes from a problem is set as text, never read as HTML.

const UNTOUCHED = 250; // ms after something is drawn in which no button works: what still comes was meant for the last
const SLOW = 400; // ms after which a wait is put into words
const AGAIN = 1000; // ms between two looks at what is computed beside a question; each failure doubles them
const MOST_FAILURES = 3; // looks that may fail: what is beside a question is then left out
const KEYS = { ArrowLeft: "a", a: "a", ArrowRight: "b", b: "b", ArrowDown: "equal", "?": "cannot tell" };
// From the worst level to the best, on a light and on a dark page: from red to blue, which nearly everybody tells apart,
// and each lighter than the one before. All stand out from what is behind them by at least 3:1.
const COLOURS = {
  light: [[36, 20, 44], [130, 11, 43], [111, 77, 18], [60, 111, 122], [47, 134, 172], [89, 151, 227]],
  dark: [[205, 76, 47], [219, 118, 46], [217, 161, 63], [145, 203, 209], [167, 220, 246], [212, 235, 253]],
};
const NUMBERS = ["no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten"];

// Draw an interview into the element `root`; `send(message)` promises the reply, or rejects with an Error whose message
// says what the person can do, and whose `saved` is true if the message is, or may be, saved and only the reply is
// missing. What may differ between hosts: `keys`, the target that hears the keyboard; `goesBack`, whether the browser's
// Back closes what is looked at beside a question; `later`, how to go on another day; `where`, where answers are saved;
// `seen`, a title and a sentence on who sees them; `titled(text)`, told where the person is. Returns a function that
// takes all of it away.
export function mount(root, send, options = {}) {
  const {
    keys = root,
    goesBack = false,
    later = "To go on, come back to this page in the same browser. If it no longer opens, ask whoever gave you its address for " +
      "a new one, or start the same command again. It continues where you are now.",
    where = "where the program runs",
    seen = ["Your answers stay here.", "They are saved on the computer where this program runs, and are sent nowhere else."],
    titled = () => {},
  } = options;
  let screen = null; // the last one drawn
  let view = "stage"; // or "answers", "legend" or "pause", which are looked at beside it
  let remarked = "stage"; // the view that the screen's note belongs to
  let listed = null; // the reply to "answers"
  let beside = null; // the reply to "outlook" for the question on the screen
  let drawn = false; // whether anything was
  let busy = false;
  let drawings = 0; // how often something was drawn
  let begun = 0; // `drawings` at the first click of a double click
  let failed = null; // what is to be tried again
  let turn = 0; // counts what was done, to tell that a reply comes too late
  let following = 0;
  let untouched = 0; // a timer
  let letters = remembered(); // whether single letters answer
  let reached = []; // by the number of answers: how far the bar was, and how many questions were still expected
  let circled = false; // whether a question was drawn in circles
  let barred = null; // id of the first question after that which is drawn in bars
  let largest = 0; // total of a question so far
  let rooms = {}; // px that a question may take, above its sides and on each side, and that the head takes
  const typed = { who: null, minutes: null }; // on the welcome, which may be drawn again

  const banner = part("div", "banner", { role: "alert" });
  const brand = part("div", "brand");
  const progress = part("div", "place"); // .progress has a style in notebooks
  const bar = part("div", "meter", { "aria-hidden": "true" }, [part("span")]);
  const note = part("p", "note", { role: "status" });
  const trying = part("div", "trying"); // a button beside the note
  const remarks = part("div", "remarks", { id: "elicit-remarks" }); // why a question is put, and the like
  // one box for both; a question has room for a line here
  const slot = part("div", "slot", {}, [part("div", "said", {}, [note, " ", remarks]), trying]);
  const waiting = part("p", "waiting", { role: "status" });
  const body = part("div", "body");
  const saved = part("span", "saved", { role: "status" });
  const nav = part("div", "nav");
  const sheet = part("div", "sheet", { tabindex: "-1" }, [
    part("div", "head", {}, [part("div", "wrap", {}, [brand, progress]), part("div", "wrap", {}, [bar])]),
    banner,
    part("div", "middle", {}, [part("div", "wrap", {}, [waiting, slot, body])]),
    part("div", "foot", {}, [part("div", "wrap", {}, [saved, nav])]),
  ]);
  hide(banner);
  root.classList.add("elicit");
  root.replaceChildren(sheet);
  root.addEventListener("pointermove", (event) => {
    if (event.movementX || event.movementY) root.classList.remove("still");
  });

  // ---- what is said to the host

  // One thing at a time: `job` is done while the buttons wait, and what it changed is drawn, unless it returns STAYS.
  // A failure is told, with a button that does it again; `lost` says what is not done.
  async function act(job, lost = "This cannot be shown yet.", wait = NEXT) {
    if (busy) return;
    busy = true;
    turn += 1;
    clearTimeout(untouched);
    const before = document.activeElement;
    sheet.setAttribute("aria-busy", "true");
    enable(false);
    const slow = setTimeout(() => {
      if (!screen) gettingReady();
      say(waiting, screen ? wait.words : GETTING_READY);
    }, wait.after);
    const slower = setTimeout(() => say(waiting, `${waiting.textContent} ${LONG}`), LONG_AFTER);
    let stays = false;
    try {
      stays = (await job()) === STAYS;
      failed = null;
    } catch (error) {
      failed = { job, lost: error.saved ? "" : lost, why: error.message, wait };
    }
    clearTimeout(slow);
    clearTimeout(slower);
    say(waiting, "");
    busy = false;
    sheet.removeAttribute("aria-busy");
    if (failed) return complain();
    hide(banner);
    if (!stays) return draw(true);
    enable(true);
    before?.focus({ preventScroll: true });
  }

  const show = (message, lost, wait) =>
    act(
      async () => {
        screen = await send(message, preparing);
        view = remarked = "stage";
      },
      lost,
      wait,
    );

  // Nothing is there to be drawn yet.
  function gettingReady() {
    if (!body.firstChild) {
      brand.replaceChildren(part("b", "", {}, ["Your judgement"]));
      progress.replaceChildren(part("b", "", {}, ["Getting ready"]));
      body.replaceChildren(
        part("h1", "heading", {}, ["Getting ready"]),
        part("p", "", {}, [PREPARING]),
        part("p", "soft", {}, ["This page goes on by itself."]),
      );
    }
  }

  // The program is not ready yet: it has been getting ready for so many seconds.
  function preparing(seconds) {
    if (!screen) gettingReady();
    say(waiting, `Getting ready: ${seconds} s so far`);
  }

  function answer(choice, words) {
    if (screen.stage === "practice") return show({ do: "practised", choice });
    body.querySelector(`[data-choice="${choice}"]`)?.closest(".card, .alt")?.classList.add("chosen");
    const lost = `Your answer (${words}) has not been saved yet.`;
    return show({ do: "answer", id: screen.question.id, choice }, lost);
  }

  const practise = () => show({ do: "practise" });

  const undo = () => show({ do: "undo", id: screen.last.id }, "The last answer has not been taken back yet.");

  const withdraw = (id) =>
    act(async () => {
      screen = await send({ do: "withdraw", id });
      remarked = view;
      if (view === "answers") listed = await send({ do: "answers" });
    }, "This answer has not been taken back yet.");

  const list = () =>
    act(async () => {
      listed = await send({ do: "answers" });
      enter();
      view = "answers";
    });

  function save(text, type, name) {
    const link = part("a", "", { href: URL.createObjectURL(new Blob([text], { type })) });
    link.download = name;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 60000);
    return STAYS;
  }

  // `kept` is the place of the words that a file was given to the browser.
  const keep = (kept) =>
    act(async () => {
      const report = await send({ do: "report" });
      say(kept, given(report.name));
      return save(report.html, "text/html", report.name);
    });

  const download = (kept, what, format) =>
    act(async () => {
      const file = await send({ do: "download", what, format });
      say(kept, given(file.name));
      return save(file.text, file.type, file.name);
    });

  function look(at) {
    if (at !== "stage") enter();
    view = at;
    draw(true);
  }

  // What is looked at beside the question has a place of its own in the browser's history.
  function enter() {
    if (goesBack && view === "stage") history.pushState({ beside: true }, "");
  }

  function closeBeside() {
    if (goesBack && history.state?.beside) history.back();
    else look("stage");
  }

  function wentBack() {
    if (view !== "stage" && !busy) look("stage");
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

  // What is computed beside a question or the welcome, until all of it is there.
  async function follow(message, drawn) {
    const mine = ++following;
    for (let failures = 0; failures <= MOST_FAILURES; ) {
      const reply = await send(message).catch(() => null);
      if (mine !== following) return;
      if (reply) drawn(reply);
      else failures += 1;
      if (reply?.ready) return;
      await new Promise((done) => setTimeout(done, AGAIN * 2 ** failures));
      if (mine !== following) return;
    }
  }

  // ---- what is drawn

  function draw(moved) {
    following += 1;
    drawings += 1;
    root.classList.add("still"); // what comes up under a resting pointer must not look chosen
    brand.replaceChildren(part("b", "", {}, [screen.title || "Your judgement"]));
    if (screen.title) brand.append(part("span", "soft", {}, ["your judgement"]));
    const stages = { welcome, practice: question, question, conflict: settling, offer, end };
    const views = { stage: stages[screen.stage], answers, pause, legend: meaning };
    remarks.replaceChildren();
    const [at, ...parts] = views[view]();
    const words = at.heading.map((one) => (typeof one === "string" ? unbroken(one) : one));
    const heading = part("h1", "heading", { tabindex: "-1" }, words);
    if (remarks.firstChild) heading.setAttribute("aria-describedby", remarks.id); // they stand above it
    body.replaceChildren(heading, ...parts);
    sheet.dataset.stage = view === "stage" ? screen.stage : view;
    progress.replaceChildren(part("b", "", {}, [at.name]), part("span", "", {}, [at.more]));
    fill(null);
    titled(screen.title ? `${at.name} - ${screen.title}` : at.name);
    say(note, view === remarked ? screen.note || "" : "");
    trying.replaceChildren(...(view === "stage" && screen.may_practise ? [button("alt", "Try again", practise, "U", "U Control+Z")] : []));
    foot();
    steady();
    enable(false);
    clearTimeout(untouched);
    untouched = setTimeout(() => enable(true), UNTOUCHED);
    beside = null;
    if (view === "stage" && screen.stage === "question") follow({ do: "outlook", id: screen.question.id }, drawBeside);
    if (view === "stage" && screen.stage === "conflict") {
      follow({ do: "consequences", id: screen.conflict.id }, drawConsequences);
    }
    if (view === "stage" && screen.stage === "welcome") follow({ do: "prospects" }, drawProspects);
    // a screen reader reads the new heading; what is only opened does not take the place of what else is there
    if (moved && drawn) {
      heading.focus({ preventScroll: true });
      if (sheet.getBoundingClientRect().top < 0) sheet.scrollIntoView();
    }
    drawn = true;
  }

  // The answers are at the same place in every question. What is above them gets room for a line of notes and for the
  // usual sentences, and the sides get room for every level and for the most circles, as far as the window has it. A
  // narrow page has room for one or the other, and questions of many have a room of their own there. Room that is left
  // over is below the sentences. A long note, and long words in the head, take of that room what they need. A question that needs more gets it, and so do all later ones.
  function steady() {
    slot.style.minHeight = "";
    const pair = body.querySelector(".lead + .pair");
    if (!pair) return;
    const [cards, lead] = [[...pair.children], pair.previousSibling];
    lead.style.minHeight = "";
    const counts = cards.map((card) => [...card.querySelectorAll(".row")]);
    for (const row of counts.flat()) row.style.minHeight = "";
    const { clientWidth: width } = body;
    // the bars of a telephone's browser come and go
    if (rooms.width !== width || Math.abs(rooms.height - window.innerHeight) > BARS_OF_BROWSER) {
      rooms = { width, height: window.innerHeight, head: Infinity };
    }
    const narrow = width < NARROW;
    const em = parseFloat(getComputedStyle(body).fontSize);
    const line = parseFloat(getComputedStyle(body).lineHeight);
    const top = waiting.parentNode; // of what is above the sides
    largest = Math.max(largest, screen.question.of);
    const linesOfCircles = Math.min(MOST_LINES, Math.ceil((narrow ? screen.question.of : largest) / 10));
    const many = narrow && linesOfCircles > 2;
    const room = (rooms[many ? "many" : "few"] ??= { lead: 0, card: 0 });
    const usual = (many ? LINES + 1 : narrow ? 0 : LINES) + (screen.legend.duration ? (narrow ? LINES_OF_DURATION : 1) : 0);
    const slotted = parseFloat(getComputedStyle(slot).minHeight);
    const notes = slotted + parseFloat(getComputedStyle(slot).marginBottom);
    const passing = trying.firstChild ? Math.max(0, slot.offsetHeight - slotted) : 0; // comes once, if at all
    if (narrow) slot.style.minHeight = "0";
    rooms.head = Math.min(rooms.head, sheet.firstChild.offsetHeight);
    const more = sheet.firstChild.offsetHeight - rooms.head;
    const down = () => pair.getBoundingClientRect().top - top.getBoundingClientRect().top;
    const between = down() - (lead.getBoundingClientRect().bottom - top.getBoundingClientRect().top);
    const heading = body.firstChild.offsetHeight + parseFloat(getComputedStyle(body.firstChild).marginBottom);
    room.lead = Math.max(room.lead, down() + more - passing, notes + heading + (usual + BETWEEN) * line + between);
    const over = room.lead - more - down();
    if (over > 0) lead.style.minHeight = `${lead.offsetHeight + over}px`;
    else slot.style.minHeight = `${Math.max(0, slot.offsetHeight + over)}px`;
    // the room that is left over is shared by the rows; all are measured before the first one changes
    const tall = counts.map((rows) => rows.map((row) => row.getBoundingClientRect().height));
    const frame = cards[0].offsetHeight - tall[0].reduce((sum, one) => sum + one, 0);
    const least = parseFloat(getComputedStyle(counts[0][0] ?? pair).minHeight) || 0;
    const { levels } = screen.question;
    const most = Math.max(least, (narrow ? linesOfCircles * LINE_OF_CIRCLES.narrow : MOST_LINES * LINE_OF_CIRCLES.wide) * em);
    const wanted = Math.max(levels * least, 2 * most + Math.max(1, Math.min(levels, 4) - 2) * least);
    // where a question can have more than a few circles, a narrow page is higher than its window
    const needed = many ? most + Math.min(levels - 1, 3) * least : 0;
    const below = (narrow ? BELOW.narrow : BELOW.wide) * em;
    const above = rooms.head + room.lead + parseFloat(getComputedStyle(top.parentNode).paddingTop);
    const apart = narrow ? 2 : 1; // the sides are below each other
    const left = (rooms.height - above - below) / apart - frame;
    const rows = Math.max(USUAL_ROWS * least, needed, Math.min(wanted, left));
    room.card = Math.max(room.card, frame + rows, ...cards.map((card) => card.offsetHeight));
    const heights = tall.map((rows, i) => rows.map((one) => one + (room.card - cards[i].offsetHeight) / rows.length));
    for (const [i, rows] of counts.entries()) {
      for (const [j, row] of rows.entries()) row.style.minHeight = `${heights[i][j]}px`;
    }
  }

  // How far the interview is: answers, of these and the questions still expected. `reply` is what came in beside the
  // question; without a forecast the bar stays where it is. It goes back only to where it was when an answer is taken
  // back. Where far fewer questions are expected than before, it comes near to that over several answers.
  function fill(reply) {
    const done = screen.answered;
    const over = screen.stage === "end" && (screen.end.finished || screen.end.settled);
    reached.length = Math.min(reached.length, done + 1);
    const left = Math.max(1, Math.min((screen.budget ?? Infinity) - done, reply?.to_come ? reply.to_come[1] + 1 : Infinity));
    if (reply && left < Infinity) {
      const before = reached.slice(0, done).findLast(Boolean) ?? { done, width: 0 };
      const width = (100 * done) / (done + left);
      const step = (STEPS * (done - before.done) * (100 - before.width)) / before.left;
      const most = done > before.done ? Math.max(before.width + step, (before.width + width) / 2) : width;
      reached[done] = { done, left, width: Math.max(before.width, reached[done]?.width ?? 0, Math.min(width, most)) };
    }
    const now = reached.findLast(Boolean);
    bar.firstChild.style.width = `${over ? 100 : (now?.width ?? 0)}%`;
    // at the end nothing is left to come, and the bar of who stopped early would not say so
    bar.hidden = ["welcome", "practice"].includes(screen.stage) || (screen.stage === "end" ? !over : !now);
    if (over) reached = []; // whoever asks for more begins anew
  }

  function foot() {
    const n = screen.saved;
    const words = n ? `${n} ${n === 1 ? "answer" : "answers"} saved ${where}` : "Nothing answered yet";
    const tick = part("span", "tick", { "aria-hidden": "true" }, ["✓ "]);
    if (!saved.textContent.endsWith(words)) saved.replaceChildren(...(n ? [tick, words] : [words]));
    const going = screen.stage !== "end" && screen.stage !== "welcome";
    const lists = screen.stage === "welcome" ? [] : [yours()];
    nav.replaceChildren(
      ...(hasLegend() && view !== "legend" ? [button("link", "What the levels mean", () => look("legend"))] : []),
      ...(view === "answers" ? [] : lists),
      ...(view === "pause" || !going ? [] : [button("link", "Pause", () => look("pause"))]),
      ...(going ? [button("link", "Finish now", () => show({ do: "finish" }, undefined, RESULT))] : []),
      ...(view === "stage" && KEYED.has(screen.stage) ? [shortcuts()] : []),
    );
  }

  function yours() {
    const made = button("link", "Your answers", list);
    const n = screen.open_conflicts;
    if (n) made.append(" ", part("span", "badge", {}, [`${n} in conflict`]));
    return made;
  }

  // Single letters can be switched off (WCAG 2.1.4); the arrow keys stay.
  function shortcuts() {
    const made = button("link", letters ? "Letter keys: on" : "Letter keys: off", () => {
      letters = !letters;
      remember(letters);
      foot();
      enable(true);
      nav.querySelector(".switch")?.focus();
    });
    sheet.dataset.letters = letters ? "on" : "off";
    made.classList.add("switch");
    made.setAttribute("aria-describedby", "elicit-letters");
    const said = part("span", "", { id: "elicit-letters" }, [letters ? LETTERS.on : LETTERS.off]);
    return part("span", "letters", {}, [made, " ", said]);
  }

  const hasLegend = () => Boolean(screen.legend.duration) || screen.legend.levels.some((one) => one.meaning);

  function legendOf() {
    const all = screen.legend.levels;
    const meant = all.some((one) => one.meaning);
    const rows = all.map((one) =>
      part("tr", "", {}, [
        part("th", "", { scope: "row" }, [icon(one.level, all.length), one.label]),
        ...(meant ? [part("td", "", {}, [one.meaning])] : []),
      ]),
    );
    const table = part("table", meant ? "legend" : "legend short", {}, [part("tbody", "", {}, rows)]);
    const stays = screen.legend.duration ? [part("p", "soft", {}, [screen.legend.duration])] : [];
    return [...stays, table];
  }

  function meaning() {
    const more = screen.preamble ? [part("p", "", {}, [screen.preamble])] : [];
    const at = { heading: ["What the levels mean"], name: "What the levels mean", more: "" };
    return [at, ...more, part("section", "panel", {}, legendOf()), returning()];
  }

  function welcome() {
    const { who: known, compare, purpose, before, source, offered, least, budgets } = screen.welcome;
    const who = part("input", "field", { type: "text", id: "elicit-who", maxlength: "80", autocomplete: "off" });
    who.value = known || (typed.who ?? "");
    who.disabled = Boolean(known); // the log is this person's
    who.addEventListener("input", () => (typed.who = who.value));
    const choices = budgets.map((one) => [`${one.minutes}`, `${one.minutes} minutes`, `about ${one.questions} questions`]);
    choices.push([SETTLED, "Until the result is settled", "fewer questions; some values may stay unknown"]);
    if (least) choices.unshift([VALUES, "Until your values are known", "the usual choice; stop any time"]);
    const usual = least ? VALUES : SETTLED;
    const radios = choices.map(([value, words, label]) => {
      const input = part("input", "", { type: "radio", name: "elicit-budget", value });
      input.checked = value === (typed.minutes ?? usual);
      input.setAttribute("aria-describedby", "elicit-likely");
      input.addEventListener("change", () => {
        typed.minutes = value;
        sayLikely();
      });
      const said = part("span", "", {}, [part("b", "", {}, [words]), " ", part("span", "soft", {}, [label])]);
      return part("label", "choice", {}, [input, said]);
    });
    // the forecast of the chosen time is below Start, which so does not move when it comes or changes
    const likely = part("p", "soft small likely", { id: "elicit-likely" });
    const start = () => {
      const time = body.querySelector("input[name='elicit-budget']:checked")?.value ?? usual;
      const chosen = [VALUES, SETTLED].includes(time) ? { minutes: "", until: time } : { minutes: time, until: SETTLED };
      show({ do: "start", who: who.value, ...chosen }, "The interview has not started yet.");
    };
    const says = [
      ["You compare.", compare],
      ["The program learns.", purpose || "It works out how good each level is to you."],
      seen,
    ].map(([title, text]) => part("p", "step", {}, [part("b", "", {}, [title]), ` ${text}`]));
    const left = part("div", "column", {}, says);
    for (const text of [screen.preamble, source].filter(Boolean)) left.append(part("p", "soft", {}, [text]));
    left.append(part("section", "panel", {}, [part("h2", "", {}, ["The levels, best to worst"]), ...legendOf()]));
    if (offered) {
      const { title, note, columns, rows, of, several } = offered;
      left.append(folded(title, columns, rows, several || `${of}s`, of, [part("p", "soft", {}, [note])], "elicit-offered"));
    }
    const form = part("section", "panel form", {}, [
      part("label", "strong", { for: "elicit-who" }, [known ? "Your name" : "Your name or initials (optional)"]),
      part("p", "soft small", {}, [`Printed on your report. ${known ? GIVEN : "A made-up name is fine."}`]),
      who,
      part("fieldset", "", {}, [part("legend", "strong", {}, ["How much time do you have?"]), ...radios]),
      button("pick", "Start", start),
      likely,
      part("p", "soft small", {}, ["A practice question comes first. ", fewest(least)]),
      part("p", "soft small", {}, [before]),
    ]);
    const right = part("div", "column", {}, [form]);
    if (screen.note_beside) right.append(part("p", "soft small", {}, [screen.note_beside]));
    const at = { heading: ["Teach the program what you value"], name: "Welcome", more: "" };
    return [at, part("div", "columns", {}, [left, right])];
  }

  const fewest = (least) =>
    least ? `We ask at least ${least} questions, checks of earlier answers included, before we call the result settled. Some questions come a second time, which shows how steady answers are.` : "";

  function question() {
    const asked = screen.question;
    const practice = screen.stage === "practice";
    const name = practice ? "Practice" : `Question ${asked.number}`;
    const parts = asked.sentences.map((sentence) => part("p", "same", {}, [sentence]));
    if (practice) remarks.append(part("p", "practice", {}, [TRY, circles(asked)]));
    if (screen.legend.duration) parts.push(part("p", "soft same duration", {}, [screen.legend.duration]));
    if (asked.icons) circled = true;
    else if (circled) barred ??= asked.id;
    if (asked.id === barred) remarks.append(part("p", "soft bars", {}, [BARS]));
    if (asked.check) remarks.append(part("p", "check", {}, [asked.check]));
    const lead = part("div", "lead", {}, parts.splice(0));
    parts.push(lead, sides(asked), others());
    if (!practice) {
      const why = part("details", "why", {}, [part("summary", "", {}, ["Why this question?"])]);
      parts.push(why);
    }
    const at = { heading: [part("span", "unseen", {}, [`${name}. `]), asked.heading], name, more: "" };
    return [at, ...parts];
  }

  // The two sides of a question. Where it is not for answering, the side that was chosen is marked.
  function sides(asked, chosen = null) {
    const counts = asked.rows.flatMap((row) => [row.a, row.b]);
    const most = Math.max(1, ...counts);
    const pair = part("div", "pair");
    // the sizes are the same in every question
    if (asked.levels > 7) pair.classList.add("many");
    pair.style.setProperty("--digits", asked.icons ? 2 : thousands(asked.of).length);
    // a longer word may be broken
    const word = Math.max(...asked.labels.flatMap((label) => label.split(/[\s-]+/).map((one) => one.length)), 0);
    pair.style.setProperty("--word", `${0.6 * Math.min(12, word)}em`);
    for (const [i, side] of ["a", "b"].entries()) {
      const words = `${asked.sides[i]} is better`;
      const heading = part("h2", "", {}, [asked.sides[i]]);
      const rows = part("ul", "rows", {}, asked.rows.map((row) => level(asked, row, row[side], most)));
      const [key, shortcut] = i ? [["→", "B"], "ArrowRight B"] : [["←", "A"], "ArrowLeft A"];
      const live = chosen === null;
      const card = part(live ? "section" : "div", "card", live ? { "aria-label": asked.sides[i] } : {}, [heading, rows]);
      if (live) {
        const pick = button("pick", words, () => answer(side, words), key, shortcut);
        pick.dataset.choice = side;
        card.append(pick); // its ::after covers the card, so that the whole card is the button
        card.classList.add("live");
      } else if (chosen === side) {
        card.classList.add("chosen");
        heading.append(part("span", "tag", {}, ["Your choice"]));
      }
      card.style.gridRow = `span ${asked.rows.length + (live ? 2 : 1)}`; // aligns the rows of both sides
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
    const back = screen.may_practise ? [] : [undoing()]; // there is a button that tries again in its place
    return part("div", "mid", { role: "group", "aria-label": "Other answers" }, [equal, unsure, ...back]);
  }

  function undoing() {
    const back = button("undo", "Take back last answer", undo, "U", "U Control+Z");
    if (screen.last) {
      back.title = `Takes back: ${screen.last.sentence}`;
      back.setAttribute("aria-description", back.title);
    } else {
      back.dataset.never = "yes";
      back.disabled = true;
    }
    return back;
  }

  // Two answers that differ, or answers that contradict each other, as they were shown, and what each choice is.
  function settling() {
    const { heading, text, answers: said, choices, id } = screen.conflict;
    const cards = said.map((one) => {
      const same = one.question.sentences.length ? [" ", part("span", "soft", {}, [one.question.sentences.join(" ")])] : [];
      const parts = [part("h2", "", {}, [one.name]), part("p", "", {}, [`You said: ${one.sentence}.`, ...same])];
      if (said.length <= 2) parts.push(sides(one.question, one.chosen));
      return part("section", "panel", {}, parts);
    });
    const buttons = choices.map(({ choice, label }, i) => {
      const made = button(i < said.length && said.length <= 2 ? "pick" : "alt", label, () =>
        show({ do: "settle", id, choice }, "Your choice has not been saved yet."),
      );
      made.dataset.keep = choice;
      const left = part("span", "soft small left", { id: `elicit-left-${i}` });
      made.setAttribute("aria-describedby", left.id);
      return part("div", "option", {}, [made, left]);
    });
    // of two answers, each has its button below it
    const own = said.length === 2 && buttons.length > 2 ? buttons.splice(0, 2) : [];
    for (const [i, made] of own.entries()) cards[i].append(made);
    const grid = part("div", said.length === 1 ? "" : "columns even", {}, cards);
    const parts = [part("p", "soft", {}, [text]), grid, part("div", "mid options", {}, buttons)];
    parts.push(part("p", "soft small", {}, ["An answer that you do not keep stays in the log, but no longer counts. What you keep can still be taken back later."]));
    return [{ heading: [heading], name: "Please check", more: "" }, ...parts, part("div", "mid stack", {}, [undoing()])];
  }

  function offer() {
    const { heading, text, options: some } = screen.offer;
    const buttons = some.map(({ option, label }, i) =>
      button(i ? "alt" : "pick", label, () => (option === "pause" ? look("pause") : choose(option))),
    );
    function choose(option) {
      show({ do: "choose", option }, undefined, option === "finish" ? RESULT : NEXT);
    }
    const parts = [part("p", "", {}, [text]), part("div", "mid options stack", {}, buttons)];
    return [{ heading: [heading], name: "Your choice", more: "" }, ...parts, part("div", "mid stack", {}, [undoing()])];
  }

  // What came in beside the question: how many more there are, and why this one.
  function drawBeside(reply) {
    if (view !== "stage") return;
    beside = reply;
    const sooner = screen.time.planned && (!beside.to_come || screen.budget - screen.answered <= beside.to_come[1]);
    progress.lastChild.textContent = sooner
      ? planned(screen.time, screen.saved, screen.budget - screen.answered)
      : `${toCome(beside.to_come, screen.time.pace, beside.at_least, beside.near)}${beside.rose ? `: ${beside.forecast}` : ""}`;
    fill(beside);
    steady(); // the words in the head may be two lines now
    const why = body.querySelector(".why");
    why?.querySelectorAll("p").forEach((p) => p.remove());
    const said = beside.why.length || beside.ready ? beside.why : ["Still being worked out ..."];
    const unsaid = said.filter((line) => !screen.question.check.includes(line)); // the note above says the others
    const lines = said.length || screen.question.check ? unsaid : ["Of all questions that could come now, this one is expected to narrow the result most."];
    const all = [...lines, beside.rose ? "" : beside.forecast].filter(Boolean);
    if (!all.length) all.push("The note above the question says why.");
    why?.append(...all.map((line) => part("p", "", {}, [line])));
  }

  // What came in beside a conflict: what each choice would leave.
  function drawConsequences({ choices }) {
    for (const one of body.querySelectorAll("[data-keep]")) say(one.nextSibling, choices[one.dataset.keep] ?? "");
  }

  // What came in beside the welcome: what each budget will likely prove.
  let prospects = null;
  function drawProspects(reply) {
    prospects = reply;
    sayLikely();
  }

  function sayLikely() {
    const place = body.querySelector(".likely");
    if (!place || !prospects) return;
    const { budgets, settled, values, ready } = prospects;
    const value = body.querySelector("input[name='elicit-budget']:checked")?.value;
    const at = screen.welcome.budgets.findIndex((one) => `${one.minutes}` === value);
    const found = value === VALUES ? values : value === SETTLED ? settled : budgets[at];
    const none = ready ? (budgets.length || settled ? "" : UNFORESEEN) : "Trying to foresee how far each choice of time gets\u00a0...";
    const goal = value === VALUES ? `${andValues(screen.welcome.width, screen.legend.levels)} ` : "";
    say(place, `${goal}${found ? `${found} ${SIMULATED}` : none}`.trim());
  }

  function end() {
    const { open, scale, certainty, statements, conflicts, changes, caution, remarks, settled, status, more } = screen.end;
    const { plan, scale_notes: notes } = screen.end;
    const after = `${status} (${answersOf(screen.end.counts.answered)})`;
    const small = body.clientWidth < NARROW; // the first two screens have all that matters, and the rest is folded
    const rest = small ? fold : section;
    const top = [part("p", settled ? "status good" : "status", {}, [settled ? `✓ ${after}` : after])];
    if (caution) top.push(part("p", "caution", {}, [caution]));
    const parts = [];
    const { sure, size, before, next, given: gave, checks, by_chance: chance, follows } = screen.end;
    const reached = [["How sure", sure], ["How close", size]];
    const main = [["Your values, from 0 to 100", screen.end.values], ["Next", next]];
    const further = [["You gave", gave], ["Checks", `${checks} ${chance}`.trim()]];
    const told = [screen.end.effect, screen.end.reason].filter(Boolean).map((text) => part("p", "reason", {}, [text]));
    // whoever wanted to know the values sees them first, and what else to do; a plan is then folded
    const apart = follows && plan;
    if (follows) parts.push(...top.splice(0), worth(scale, certainty, notes, small));
    if (follows && !apart) top.push(part("h2", "", {}, [unbroken(follows)]));
    if (!apart) {
      top.push(...told);
      main.splice(1, 0, ...reached);
      further.unshift(["Before", before]);
    }
    top.push(facts(small ? main : [...main, ...further]));
    for (const said of remarks) top.push(part("p", "caution", {}, [said]));
    const kept = part("p", "soft small kept", { role: "status" });
    const doing = [button("pick", "Download report", () => keep(kept))];
    if (more) doing.push(button("alt", "Ask me more", () => show({ do: "more" })));
    top.push(part("div", "mid closing", {}, [...doing, undoing()]), kept);
    parts.push(part("section", "panel", {}, top));
    if (open) parts.push(part("p", "same", {}, [open]));
    parts.push(...conflicts.map(conflict));
    if (scale.length && !follows) parts.push(worth(scale, certainty, notes, small));
    const tables = [...(changes ? [changed(changes, rest)] : []), ...(plan ? [whole(plan, rest)] : [])];
    if (apart) parts.push(fold(`The plan: ${unbroken(follows)}`, [...told, facts([...reached, ["Before", before]]), ...tables]));
    else parts.push(...tables);
    if (statements.length) parts.push(rest("What else follows", lines(statements)));
    if (small && further.some(([, text]) => text)) parts.push(fold("Your answers and their checks", [facts(further)]));
    parts.push(rest("Downloads", files(screen.end.downloads)));
    const limits = [screen.end.source, ...screen.end.limits].filter(Boolean).map((line) => part("p", "soft small", {}, [line]));
    const about = [...limits, ...technical(screen.end.facts)];
    if (about.length) parts.push(small ? fold("About this result", about) : part("div", "part", {}, about));
    return [{ heading: [screen.end.headline || "There are no more questions"], name: "Result", more: "" }, ...parts];
  }

  function facts(all) {
    const named = all.filter(([, text]) => text).flatMap(([a, b]) => [part("dt", "", {}, [a]), part("dd", "", {}, [b])]);
    return part("dl", "facts", {}, named);
  }

  function files(downloads) {
    const kept = part("p", "soft small kept", { role: "status" });
    const rows = downloads.map(({ what, name }) => {
      const buttons = ["csv", "json"].map((format) => {
        const made = button("back", format.toUpperCase(), () => download(kept, what, format));
        made.setAttribute("aria-label", `${name} as ${format.toUpperCase()}`);
        return made;
      });
      const words = part("span", "", {}, [part("b", "", {}, [name]), ` ${FILES[what]}`]);
      return part("li", "", {}, [words, part("span", "buttons", {}, buttons)]);
    });
    return [part("ul", "list", {}, rows), kept];
  }

  // What the answers change: a heading, a note, and a table that can be filtered, and is folded unless it is `unfolded`.
  // What is still open has a table of its own.
  function changed({ title, note: remark, columns, rows, of, several, open, unfolded, marked, mark }, rest) {
    const made = remark.split("\n").map((words) => part("p", "soft", {}, [words]));
    if (rows.length) {
      const table = folded(title, columns, rows, several || `${of}s`, of, [], "elicit-filter");
      const line = marked === null ? null : table.querySelectorAll("tbody tr")[marked];
      line?.classList.add("chosen");
      line?.firstChild.append(" ", part("span", "tag", {}, [mark]));
      table.open = Boolean(unfolded);
      made.push(table);
    }
    if (open) {
      const said = [part("p", "soft", {}, [open.note])];
      made.push(folded(open.title, open.columns, open.rows, `${open.of}s`, open.of, said, "elicit-filter-open"));
    }
    return rest(title, made);
  }

  // The plan everywhere, whether the answers change it, and whether that is certain.
  function whole({ title, note: remark, columns, rows, of }, rest) {
    const kinds = [...new Set(rows.map((row) => row.at(-1)))];
    return rest(title, [
      part("p", "soft", {}, [remark]),
      folded(title, columns, rows, `${of}s`, of, [], "elicit-filter-plan", kinds.length > 1 ? kinds : []),
    ]);
  }

  // A table that is folded and can be filtered: by words, and by the `kinds` of its last column.
  function folded(title, columns, rows, several, of, said, id, kinds = []) {
    const numbers = columns.map((_, i) => i > 0 && rows.every((row) => NUMBER.test(row[i])));
    const found = part("p", "soft small", { role: "status" }, [`${rows.length} of ${rows.length} shown`]);
    const field = part("input", "field", { type: "search", id, autocomplete: "off" });
    const lines = rows.map(([first, ...cells]) =>
      part("tr", "", { role: "row" }, [
        part("th", "", { scope: "row", role: "rowheader" }, [first]),
        ...cells.map((cell, i) => part("td", numbers[i + 1] ? "number" : "", { role: "cell", "data-head": columns[i + 1] }, [cell])),
      ]),
    );
    const kind = part("select", "field", { id: `${id}-kind`, "aria-label": `Show only: ${columns.at(-1).toLowerCase()}` }, [
      part("option", "", { value: "" }, ["all"]),
      ...kinds.map((one) => part("option", "", { value: one }, [`${one} (${rows.filter((row) => row.at(-1) === one).length})`])),
    ]);
    const filter = () => {
      const wanted = field.value.trim().toLowerCase();
      let n = 0;
      for (const [i, line] of lines.entries()) {
        line.hidden = !rows[i].join(" ").toLowerCase().includes(wanted) || Boolean(kind.value && rows[i].at(-1) !== kind.value);
        n += !line.hidden;
      }
      say(found, `${n} of ${rows.length} shown`);
    };
    field.addEventListener("input", filter);
    kind.addEventListener("change", filter);
    const heads = columns.map((column, i) => part("th", numbers[i] ? "number" : "", { scope: "col", role: "columnheader" }, [column]));
    const longer = rows.some((row) => row.at(-1).length > SHORT) ? " longer" : "";
    const table = part("table", `changes${columns.length > 3 ? " many" : ""}${longer}`, { role: "table" }, [
      part("thead", "", { role: "rowgroup" }, [part("tr", "", { role: "row" }, heads)]),
      part("tbody", "", { role: "rowgroup" }, lines),
    ]);
    const label = part("label", "", { for: id }, ["Filter the table "]);
    const scrolls = part("div", rows.length > FEW ? "scrolls" : "scrolls all", { tabindex: "0", role: "region", "aria-label": title }, [table]);
    const words = rows.length === 1 ? `the ${of}` : `the ${rows.length} ${several}`;
    const summary = part("summary", "", {}, [`Show ${words}`]);
    const choice = kinds.length ? [part("label", "", { for: `${id}-kind` }, ["Show "]), kind] : [];
    const filters = rows.length > FEW ? [part("div", "filter", {}, [label, field, ...choice, found])] : [];
    const made = part("details", "panel", {}, [summary, ...said, ...filters, scrolls]);
    made.addEventListener("toggle", () => say(summary, `${made.open ? "Hide" : "Show"} ${words}`));
    return made;
  }

  // Answers that contradict each other, each of which can be taken back.
  function conflict(entries) {
    const items = entries.map(({ id, sentence }) =>
      part("li", "", {}, [part("span", "", {}, [sentence]), back(id, sentence)]),
    );
    const n = NUMBERS[entries.length] ?? entries.length;
    const [which, mends] =
      entries.length === 1
        ? ["This answer goes against the order of the levels", "Do you mean it? The other answers stay."]
        : [`These ${n} answers contradict each other`, MENDS];
    const hint = part("p", "soft", {}, [mends]);
    return part("section", "conflict", {}, [part("h2", "", {}, [which]), part("ul", "list", {}, items), hint]);
  }

  // An old answer is taken back in two steps, for it cannot be put back. Until then nothing is sent.
  function back(id, sentence) {
    const place = part("div", "buttons");
    const take = button("back", "Take back", () => {
      const yes = button("back", SURE.yes, () => withdraw(id));
      const no = button("back", SURE.no, () => {
        place.replaceChildren(take);
        take.focus({ preventScroll: true });
      });
      for (const [one, words] of [[yes, SURE.yes], [no, SURE.no]]) one.setAttribute("aria-label", `${words}: ${sentence}`);
      place.replaceChildren(yes, no);
      yes.focus({ preventScroll: true });
    });
    take.setAttribute("aria-label", `Take back: ${sentence}`);
    place.append(take);
    return place;
  }

  function answers() {
    const standing = new Map(listed.answers.filter((one) => !one.withdrawn).map((one) => [one.id, one]));
    const items = listed.answers.map((one) => {
      const said = part("span", "", {}, [part("span", "soft", {}, [`${one.number}. `]), part(one.stands ? "span" : "s", "", {}, [one.sentence])]);
      const words = part("span", "words", {}, [said]);
      words.append(...one.remarks.map((tag) => part("span", FAULT.test(tag) ? "tag" : "tag plain", {}, [tag])));
      const when = one.time && new Date(one.time).toLocaleString(undefined, WHEN);
      if (when) words.append(part("time", "soft", { datetime: one.time }, [when]));
      return part("li", one.stands ? "" : "gone", {}, one.withdrawn ? [words] : [words, back(one.id, one.sentence)]);
    });
    const conflicts = listed.conflicts.map((ids) => conflict(ids.map((id) => standing.get(id)).filter(Boolean)));
    const none = part("p", "", {}, ["There are none yet."]);
    const list = part("ul", "list", {}, items.reverse());
    const parts = [...conflicts, items.length ? list : none, returning()];
    return [{ heading: ["Your answers"], name: "Your answers", more: "" }, ...parts];
  }

  function pause() {
    const parts = [part("p", "", {}, [`Everything is saved ${where}. You can close this window now.`])];
    parts.push(part("p", "", {}, [later]), returning());
    return [{ heading: ["Paused"], name: "Paused", more: "" }, ...parts];
  }

  function returning() {
    const to = { end: " to the result", practice: " to the question", question: " to the question" };
    const words = `Back${to[screen.stage] ?? ""}`;
    return part("div", "mid", {}, [button("pick", words, closeBeside)]);
  }

  function complain() {
    const { job, lost, why, wait } = failed;
    const again = button("alt", "Try again", () => act(job, lost, wait));
    banner.replaceChildren(part("p", "", {}, [...(lost ? [part("b", "", {}, [lost]), " "] : []), why]), again);
    banner.hidden = false;
    if (!screen) body.replaceChildren(part("h1", "heading", {}, ["Not ready yet"])); // there is no other heading
    body.querySelectorAll(".live.chosen, .alt.chosen").forEach((one) => one.classList.remove("chosen"));
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
    if (key === "Escape" && view !== "stage" && !busy && !failed) return closeBeside();
    const writing = event.target.closest?.("input, textarea, select, [contenteditable]");
    if (event.repeat || event.altKey || event.defaultPrevented || writing || busy || failed || view !== "stage") return;
    const control = event.ctrlKey || event.metaKey;
    if (!control && !letters && key.length === 1) return;
    const undone = control ? key === "z" && !event.shiftKey : key === "u" && !event.shiftKey;
    const choice = control || (event.shiftKey && key !== "?") ? undefined : KEYS[key];
    const pushed = undone ? (trying.querySelector("button") ?? body.querySelector(".undo")) : choice && body.querySelector(`[data-choice="${choice}"]`);
    if (!pushed) return;
    // where the answers are still below the edge, this key is for going there
    if (key === "ArrowDown" && pushed.getBoundingClientRect().bottom > window.innerHeight) return;
    event.preventDefault();
    event.stopPropagation();
    pushed.click();
  }

  // the second click of a double click was meant for what is gone, however slow it is
  function clicked(event) {
    if (event.detail < 2) begun = drawings;
    else if (begun !== drawings) {
      event.preventDefault();
      event.stopPropagation();
    }
  }

  body.addEventListener("click", clicked, true);
  keys.addEventListener("keydown", pressed);
  window.addEventListener("focus", catchUp);
  window.addEventListener("resize", steady);
  document.addEventListener("visibilitychange", catchUp);
  if (goesBack) window.addEventListener("popstate", wentBack);
  show({ do: "state" });
  return () => {
    following += 1;
    clearTimeout(untouched);
    keys.removeEventListener("keydown", pressed);
    window.removeEventListener("focus", catchUp);
    window.removeEventListener("resize", steady);
    document.removeEventListener("visibilitychange", catchUp);
    window.removeEventListener("popstate", wentBack);
    root.replaceChildren();
  };
}

const USUAL_ROWS = 3; // levels that get room even in a low window
const LINES = 2; // of the sentences above the sides
const BETWEEN = .42; // of a line, between two of them
const LINES_OF_DURATION = 2; // on a narrow page
const MOST_LINES = 5; // of circles: ten in a line, and at most 50
const LINE_OF_CIRCLES = { wide: 1.24, narrow: .96 }; // em, with the gap below it
const BELOW = { wide: 9.3, narrow: 4.7 }; // em that the other answers take below the sides, and on a wide page what follows
const BARS_OF_BROWSER = 120; // px
const STEPS = 2; // how many times as far as expected the bar goes at one answer, unless that is not half the way
const NARROW = 640; // px of width, as the style has it
const SHORT = 10; // letters of a cell that has room in half a narrow page
const FEW = 12; // rows that need no filter, and are shown at once
const NEXT = { words: "Working out what comes next ...", after: SLOW };
const GETTING_READY = "Getting ready ...";
const LONG_AFTER = 8000; // ms after which a wait is explained
const LONG = "This takes longer on a busy computer. You can wait, or come back to this page later: nothing is lost.";
const RESULT = { words: "Working out your result ...", after: 50 };
const PREPARING = "This takes a few seconds. The first start on a computer takes up to two minutes.";
const TRY = "Practice question: your answer is not saved.";
const BARS = "These numbers are too large to draw circles, so the length of a bar shows how many.";
const SIMULATED = "These forecasts are from simulated people whose values differ.";
const UNFORESEEN = "How far each choice of time gets cannot be foreseen here. You will see it as you go.";
const VALUES = "values"; // choices of time that are no minutes
const SETTLED = "settled";
const andValues = (width, [best, ...others]) =>
  `It goes on until the value of each level is known to within a range of ${width}, on a scale from 0 (“${others.at(-1).label}”) to 100 (“${best.label}”).`;
const MEANT = "If no answer is a mistake"; // head of a column
const MISTAKES = "Allowing for mistakes"; // head of the column beside it
const GIVEN = "It was given when the program was started.";
const MENDS = "Taking back any one of them fixes it. The others stay.";
const SURE = { yes: "Yes, take it back", no: "No, keep it" };
const LETTERS = { on: "A, B, ? and U work", off: "only the arrow keys work" };
const KEYED = new Set(["practice", "question"]); // stages that letters answer
const NUMBER = /^(-|not known yet|-?\d[\d.,]*( to \d+)?( \((at least|or) [^)]*\))?)$/; // a cell to be set right-aligned
const STAYS = "stays"; // returned by what changes nothing on the screen
const TIME = { hour: "2-digit", minute: "2-digit", hourCycle: "h23", timeZoneName: "short" };
const WHEN = { year: "numeric", month: "short", day: "numeric", ...TIME };
const FILES = {
  scale: "the value and range of each level",
  plan: "what follows from your answers",
  outcomes: "the share that ends in each outcome, with your plan and with equal steps",
  answers: "each one, with both sides as you saw them, and whether it is used",
};
const FAULT = /contradicts|^ignored|differs/; // what a remark on an answer says that may need mending
const REMEMBERED = "elicit: letter keys";

// Whether letters answer, as it was set last in this browser, which may forbid to remember anything.
function remembered() {
  try {
    return localStorage.getItem(REMEMBERED) !== "off";
  } catch {
    return true;
  }
}

function remember(on) {
  try {
    localStorage.setItem(REMEMBERED, on ? "on" : "off");
  } catch {
    // it then holds for this window only
  }
}

// An element with a class, attributes, and what is in it: elements, or strings, which stay text.
export function part(tag, name, attributes = {}, inside = []) {
  const made = document.createElement(tag);
  if (name) made.className = name;
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.append(...inside);
  return made;
}

// A button; `key` is the key that it shows, or several.
export function button(name, words, done, key, shortcut) {
  const kind = (one) => (/^[A-Z?]$/.test(one) ? "letter" : "");
  const hint = [key ?? []].flat().map((one) => part("kbd", kind(one), { "aria-hidden": "true" }, [one]));
  const made = part("button", name, { type: "button" }, [...hint, words]);
  if (shortcut) made.setAttribute("aria-keyshortcuts", shortcut);
  made.addEventListener("click", done);
  return made;
}

// Neither "1 in 100" nor a level and its value are parted at the end of a line.
const unbroken = (text) => text.replace(/(\d) in (\d)/g, "$1\u00a0in\u00a0$2").replace(/ (\d+[,.:])/g, "\u00a0$1");

export function section(title, inside) {
  return part("section", "part", {}, [part("h2", "", {}, [title]), ...inside]);
}

// A section that opens at its heading.
function fold(title, inside) {
  return part("details", "fold", {}, [part("summary", "", {}, [part("h2", "", {}, [title])]), ...inside]);
}

// What only somebody who checks a result needs: the problem, the seed, and so on.
export function technical(facts) {
  if (!facts.length) return [];
  const named = facts.flatMap(([name, value]) => [part("dt", "", {}, [name]), part("dd", "", {}, [value])]);
  const summary = part("summary", "", {}, ["Technical details"]);
  return [part("details", "technical", {}, [summary, part("dl", "facts small", {}, named)])];
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
  if (asked.icons) {
    const all = Array.from({ length: n }, () => icon(row.level, asked.levels));
    const fives = [];
    while (all.length) fives.push(part("span", "five", {}, all.splice(0, 5)));
    while (fives.length) picture.append(part("span", "ten", {}, fives.splice(0, 2)));
  } else {
    const bar = painted(part("span", "bar"), colourOf(row.level, asked.levels));
    bar.style.width = `${(100 * n) / most}%`;
    if (n) picture.append(bar);
  }
  const words = [part("span", "n", {}, [thousands(n)]), " ", part("span", "label", {}, [row.label]), picture];
  return part("li", n ? "row" : "row none", {}, words);
}

const circles = (asked) =>
  asked.icons ? ` Each circle is one of the ${asked.unit}: ✓ is the best level, ✕ the worst.` : "";

function icon(level, levels) {
  const mark = level === 0 ? "✕" : level === levels - 1 ? "✓" : "";
  const made = part("i", mark ? `icon marked${level ? "" : " worst"}` : "icon", { "aria-hidden": "true" }, [mark]);
  return painted(made, colourOf(level, levels));
}

// The style sheet takes the one that suits the page.
function painted(element, { light, dark }) {
  element.style.setProperty("--light", light);
  element.style.setProperty("--dark", dark);
  element.classList.add("painted");
  return element;
}

// The colours of a level on a light and on a dark page.
export function colourOf(level, levels) {
  const at = (level / Math.max(1, levels - 1)) * (COLOURS.light.length - 1);
  const low = Math.min(Math.floor(at), COLOURS.light.length - 2);
  const between = (all) => all[low].map((x, i) => Math.round(x + (at - low) * (all[low + 1][i] - x)));
  return { light: `rgb(${between(COLOURS.light)})`, dark: `rgb(${between(COLOURS.dark)})` };
}

// What the levels are worth, as a table whose middle column is a picture. A level of which too little is known has no
// best guess. Where answers taken as given leave less than a whole range, a column has that. On a `small` page how to
// read it is folded.
function worth(scale, certainty, notes, small) {
  const both = scale.some(({ given: taken, low, high }) => narrower(taken, low, high));
  const head = ["Level", null, "Best guess", ...(both ? [MEANT, MISTAKES] : ["Range"])].map((words) =>
    words
      ? part("th", words === MEANT ? "meant" : "", { scope: "col", role: "columnheader" }, [words])
      : part("td", "drawn", { role: "cell" }, [axis()]),
  );
  const rows = scale.map((row, i) => {
    const { label, value, low, high, asked, known, rough } = row;
    const taken = both ? row.given : null;
    const range = low === high ? "fixed" : `${low} to ${high}`;
    const meant = taken && low !== high ? (taken[0] === taken[1] ? String(taken[0]) : `${taken[0]} to ${taken[1]}`) : "";
    const name = asked ? [label] : [label, part("span", "soft small never", {}, ["never asked"])];
    return part("tr", "", { role: "row" }, [
      part("th", "", { scope: "row", role: "rowheader" }, name),
      part("td", "drawn", { role: "cell" }, [
        interval(low, value, high, colourOf(scale.length - 1 - i, scale.length), known, rough, taken),
      ]),
      part("td", "number", { role: "cell" }, [guessWords(row)]),
      ...(both ? [part("td", "number meant", { role: "cell", "data-head": MEANT }, [meant])] : []),
      part("td", "number", { role: "cell" }, [range]),
    ]);
  });
  const [best, worst] = [scale[0].label, scale.at(-1).label];
  const ends = `From 0 (“${worst}”) to 100 (“${best}”).`;
  const said = [
    `A level at 60 is as good to you as 60 of 100 at “${best}” and 40 at “${worst}”.`,
    `Dot: best guess. ${both ? "Thick bar: range if no answer is a mistake. Thin bar: range allowing for mistakes" : "Bar: range"} (${certainty}).`,
  ].join(" ");
  // roles, because a narrow page lays the rows out as a grid, which takes the table's own roles away
  const table = part("table", both ? "worth both" : "worth", { role: "table" }, [
    part("caption", "soft", {}, [small ? ends : `${ends} ${said}`]),
    part("thead", "", { role: "rowgroup" }, [part("tr", "", { role: "row" }, head)]),
    part("tbody", "", { role: "rowgroup" }, rows),
    // a narrow page has the axis here, for there the heads stand right above the numbers
    part("tfoot", "", { role: "rowgroup" }, [part("tr", "", { role: "row" }, [part("td", "drawn", { role: "cell" }, [axis()])])]),
  ]);
  const below = (small ? [said, ...notes] : notes).join(" ");
  const noted = below ? [part("p", "soft small below", {}, [below])] : [];
  const reading = small ? [part("details", "", {}, [part("summary", "", {}, ["How to read this"]), ...noted])] : noted;
  return section("What the levels are worth to you", [part("div", "panel", {}, [table, ...reading])]);
}

function svg(tag, attributes, inside = []) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.append(...inside);
  return made;
}

export function axis() {
  const marks = [0, 50, 100].map((x) => svg("text", { x: `${x}%`, y: 14, "text-anchor": "middle" }, [String(x)]));
  return svg("svg", { class: "axis", "aria-hidden": "true", focusable: "false" }, marks);
}

// A level's best guess, or words in its place.
export const guessWords = ({ value, known, rough }) => {
  if (known) return String(Math.round(value));
  return rough ? `about\u00a0${Math.round(value)}` : "not known yet";
};

// Whether the range of a level if every answer is meant as it was `taken` is there, and less than the whole one.
const narrower = (taken, low, high) => Boolean(taken) && taken[1] - taken[0] < high - low;

// A level's range with a dot at its best guess. One of which too little is `asked` has a hollow bar, and a hollow dot if
// it is known roughly. The range if every answer is meant as it was `taken` is a thick bar, and the whole one then thin.
export function interval(low, value, high, colour, asked, rough = false, taken = null) {
  const marks = [0, 25, 50, 75, 100].map((x) => `${x}%`);
  const grid = marks.map((x) => svg("line", { class: "grid", x1: x, x2: x, y1: 0, y2: "100%" }));
  const [x, width] = [`${low}%`, `${high - low}%`];
  const two = narrower(taken, low, high);
  const bar = two ? { x, width, y: "40%", height: "20%", rx: 2 } : { x, width, y: "25%", height: "50%", rx: 3 };
  const parts = [asked ? painted(svg("rect", { ...bar, class: "open" }), colour) : svg("rect", { ...bar, class: "open unknown" })];
  if (two) {
    const inner = { class: "open", x: `${taken[0]}%`, width: `${taken[1] - taken[0]}%`, y: "25%", height: "50%", rx: 3 };
    parts.push(painted(svg("rect", inner), colour));
  }
  const end = low === high;
  if (end) parts.push(painted(svg("circle", { class: "fixed", cx: `${value}%`, cy: "50%", r: 7 }), colour));
  else if (asked) parts.push(svg("circle", { class: "guess", cx: `${value}%`, cy: "50%", r: 4 }));
  else if (rough) parts.push(svg("circle", { class: "roughly", cx: `${value}%`, cy: "50%", r: 4 }));
  return svg("svg", { class: "interval", "aria-hidden": "true", focusable: "false" }, [...grid, ...parts]);
}

// How far the person is in the time that they have.
function planned({ planned: minutes, spent }, answered, further) {
  const left = Math.max(0, Math.round(minutes - spent / 60));
  const more = Math.max(0, further);
  if (!more) return `your ${minutes} minutes are over`;
  return `${answered} answered, time for about ${more} more (${left < 1 ? "under 1" : left} of ${minutes} minutes left)`;
}

function toCome(range, seconds, atLeast, near) {
  if (!range) return atLeast ? `at least ${atLeast} more` : "";
  const [least, most] = range;
  if (most === 0) return "close to the end"; // often, but not always, the last one
  const minutes = Math.max(1, Math.round((most * seconds) / 60));
  const time = `${minutes}\u00a0min`;
  if (near) return `probably close to the end, at most about ${most} more`;
  if (least === most) return `about ${most} more, up to ${time}`;
  // no promise: an answer can open more than it closes
  return least === 0 ? `up to about ${most} more (${time})` : `about ${least} to ${most} more, up to ${time}`;
}

const given = (name) => `Given to your browser as ${name}: look among its downloads.`;

const answersOf = (n) => (n ? `${n} ${n === 1 ? "answer" : "answers"}` : "no answers");

const thousands = (n) => n.toLocaleString("en-US");

function same(one, other) {
  const [a, b] = [one, other].map((s) =>
    JSON.stringify([s.stage, s.question?.id, s.conflict?.id, s.answered, s.last?.id]),
  );
  return a === b;
}
