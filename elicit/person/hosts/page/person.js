// The page of one person of a study. Its messages go to a program that somebody else may run.

import { mount } from "./interview.js";
import { sender } from "./send.js";

const STOPPED = "The study does not answer. Press Try again in a moment. All earlier answers are saved.";
const SHUT_OUT =
  "This link is no longer valid. Ask whoever runs the study for a new one, and open it in this browser. All earlier " +
  "answers are saved.";

mount(document.getElementById("interview"), sender(STOPPED, SHUT_OUT), {
  keys: document,
  goesBack: true,
  later: "To go on, open this page again in the same browser. If it is not open to you, ask for a new link.",
  where: "for the study",
  seen: ["This is a study.", "Whoever runs it sees your answers. The other people who answer do not."],
  titled(text) {
    document.title = text;
  },
});
