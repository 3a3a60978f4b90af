// The WebSocket: requests as JSON, answers as a header in JSON followed by the bytes of an array.

const RETRY_MILLISECONDS = 1500;
const LOST = "The connection is lost. Trying again.";
const OUTDATED =
  "This address is no longer valid, because the viewer was started again. Open the address that the terminal shows.";

/** Return whether a server refuses this page. The secret of its address is that of an earlier server. */
async function isRefused() {
  // Browsers hide why a WebSocket is refused.
  const answer = await fetch("page/connection.js").catch(() => null);
  return answer?.status === 403;
}

/** Return the header and the bytes of a binary message. */
export function decode(buffer) {
  const length = new DataView(buffer).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  return { header, bytes: new Uint8Array(buffer, 4 + length) };
}

export class Connection {
  constructor(onMessage, onChange) {
    this.onMessage = onMessage;
    this.onChange = onChange;
    this.open();
  }

  open() {
    const scheme = location.protocol === "https:" ? "wss:" : "ws:";
    this.socket = new WebSocket(`${scheme}//${location.host}/stream`);
    this.socket.binaryType = "arraybuffer";
    // A server that has too many pages accepts the connection, but sends nothing.
    this.isOpen = false;
    const begin = () => {
      this.isOpen = true;
      this.onReopen?.(); // requests from before the loss get no answer
      this.onChange(true, "");
    };
    this.socket.onmessage = (event) => {
      const { header, bytes } = decode(event.data);
      if (!this.isOpen) begin();
      // Without a confirmation, the server stops sending.
      if (header.type === "image" || header.type === "overlay") this.send({ type: "ack" });
      this.onMessage(header, bytes);
    };
    this.socket.onclose = async (event) => {
      const wasOpen = this.isOpen;
      this.isOpen = false;
      this.onChange(false, wasOpen || !(await isRefused()) ? event.reason || LOST : OUTDATED);
      setTimeout(() => this.open(), RETRY_MILLISECONDS);
    };
  }

  send(message) {
    if (this.isOpen) this.socket.send(JSON.stringify(message));
  }
}
