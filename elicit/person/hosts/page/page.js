// The page's side of an interview: messages go to the program on this computer that served the page.

import { mount } from "./interview.js";

const STOPPED =
  "The program on this computer does not answer. Start it again with the same command, then press Try again. If it " +
  "prints a new address, open that. All earlier answers are saved.";
const SHUT_OUT =
  "The program was restarted. Open the new address in this browser, then press Try again here, or go on there.";

async function send(message) {
  const sent = { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(message) };
  const reply = await fetch("api", sent).catch(() => {
    throw new Error(STOPPED);
  });
  if (reply.status === 403) throw new Error(SHUT_OUT);
  const content = await reply.json().catch(() => {
    throw new Error(STOPPED);
  });
  if (!reply.ok) throw new Error(content.error ?? `The program answers ${reply.status}. Press Try again.`);
  return content;
}

mount(document.getElementById("interview"), send, {
  keys: document,
  titled(text) {
    document.title = text;
  },
});
