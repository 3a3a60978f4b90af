// The WebSocket: requests as JSON, answers as a header in JSON followed by the bytes of an array.

const RETRY_MILLISECONDS = 1500;

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
    this.socket.onmessage = (event) => {
      const { header, bytes } = decode(event.data);
      // Without a confirmation, the server stops sending.
      if (header.type === "image" || header.type === "overlay") this.send({ type: "ack" });
      this.onMessage(header, bytes);
    };
    this.socket.onclose = (event) => {
      this.onChange(false, event.reason);
      setTimeout(() => this.open(), RETRY_MILLISECONDS);
    };
    this.socket.onopen = () => {
      this.onReopen?.(); // requests from before the loss get no answer
      this.onChange(true, "");
    };
  }

  get isOpen() {
    return this.socket.readyState === WebSocket.OPEN;
  }

  send(message) {
    if (this.isOpen) this.socket.send(JSON.stringify(message));
  }
}
