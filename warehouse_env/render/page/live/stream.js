// The messages of the server, one after the other; train/live/messages.py says what they are.

const AGAIN = 1000; // [ms] until a lost server is tried again

// Hear for ever. heard(message): of each one; lost(): whenever the server does not answer.
async function listen(heard, lost) {
  for (;;) {
    try {
      const response = await fetch("states", { cache: "no-store" });
      if (!response.ok) throw new Error((await response.json()).error);
      await hear(response.body.getReader(), heard);
      lost("The simulation has ended.");
    } catch (error) {
      lost(error instanceof TypeError ? "The simulation does not answer; is it still running?" : error.message);
    }
    await new Promise((done) => setTimeout(done, AGAIN));
  }
}

async function hear(reader, heard) {
  let rest = new Uint8Array(0);
  for (;;) {
    const { done, value } = await reader.read();
    if (done) return;
    const bytes = new Uint8Array(rest.length + value.length);
    bytes.set(rest);
    bytes.set(value, rest.length);
    rest = bytes.subarray(readMessages(bytes, heard));
  }
}

// Read the messages that are complete; returns where the next one begins.
function readMessages(bytes, heard) {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  let at = 0;
  while (at + 4 <= bytes.length) {
    const size = view.getUint32(at, true);
    if (at + 4 + size > bytes.length) break;
    try {
      if (size) heard(readMessage(bytes.subarray(at + 8, at + 4 + size), view.getUint32(at + 4, true)));
    } catch (error) {
      reportError(error); // ours, not the network's
    }
    at += 4 + size;
  }
  return at;
}

function readMessage(bytes, length) {
  const message = JSON.parse(new TextDecoder().decode(bytes.subarray(0, length)));
  return { ...message, columns: readColumns(message.columns, bytes.subarray(length)) };
}
