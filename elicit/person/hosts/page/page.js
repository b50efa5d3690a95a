// The page's side of an interview: messages go to the program on this computer that served the page.

import { mount } from "./interview.js";
import { sender } from "./send.js";

const STOPPED =
  "The program on this computer does not answer. Start it again with the same command, then press Try again. If it " +
  "prints a new address, open that. All earlier answers are saved.";
const SHUT_OUT =
  "The program was restarted. Open the new address in this browser, then press Try again here, or go on there.";

mount(document.getElementById("interview"), sender(STOPPED, SHUT_OUT), {
  keys: document,
  goesBack: true,
  titled(text) {
    document.title = text;
  },
});
