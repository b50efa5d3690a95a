// Messages to the program that served the page: a function that promises the reply to one. `stopped` and `shutOut` say
// what to do where the program does not answer, and where it does not let in this browser. While the program gets
// ready the message is sent again, and `preparing(seconds)` is told how long that has taken.
const AGAIN = 500; // ms

export function sender(stopped, shutOut) {
  return async function send(message, preparing = () => {}) {
    for (;;) {
      const reply = await once(message);
      if (reply.getting_ready === undefined) return reply;
      preparing(reply.getting_ready);
      await new Promise((done) => setTimeout(done, AGAIN));
    }
  };

  async function once(message) {
    const sent = { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(message) };
    const reply = await fetch("api", sent).catch(() => {
      throw new Error(stopped);
    });
    if (reply.status === 403) throw new Error(shutOut);
    const content = await reply.json().catch(() => null);
    if (reply.ok && !content) throw new Error(stopped);
    if (!reply.ok) {
      const error = new Error(content?.error ?? `The program answers ${reply.status}. Press Try again.`);
      error.saved = content?.saved === true;
      throw error;
    }
    return content;
  }
}
