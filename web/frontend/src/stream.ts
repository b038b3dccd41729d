// The live stream: hello, then binary frames and JSON. Reconnects each second; the backlog in each hello refills the gap.

import { log, seedEvents } from "./alerts";
import type { Hello, StationEvent, Status } from "./protocol";
import { ring } from "./ring";
import { state, update } from "./store";

const RETRY_MS = 1000;
const SILENCE_MS = 4000;

type Message = Hello | ({ type: "status" } & Status) | { type: "status"; status: Status } | { type: "event"; event?: StationEvent };

let socket: WebSocket | null = null;
let heardMs = 0;

function lose(): void {
  if (state.station !== "lost") update({ station: "lost", stationLostMs: performance.now() });
}

function statusOf(message: Record<string, unknown>): Status {
  return (message.status ?? message) as Status;
}

function read(text: string): void {
  const message = JSON.parse(text) as Message;
  if (message.type === "hello") {
    ring.layout(message.signals, message.frame_size);
    seedEvents(message.events);
    update({ station: "live", ...(message.status ? { status: message.status, statusMs: performance.now() } : {}) });
  } else if (message.type === "status") {
    update({ status: statusOf(message as unknown as Record<string, unknown>), statusMs: performance.now() });
  } else if (message.type === "event") {
    log((message.event ?? message) as StationEvent);
  }
}

function open(): void {
  const scheme = location.protocol === "https:" ? "wss" : "ws";
  const next = new WebSocket(`${scheme}://${location.host}/ws/stream`);
  next.binaryType = "arraybuffer";
  next.onmessage = (event: MessageEvent<string | ArrayBuffer>) => {
    heardMs = performance.now();
    if (typeof event.data === "string") read(event.data);
    else ring.append(new Float64Array(event.data), heardMs);
  };
  next.onclose = () => {
    if (socket !== next) return;
    lose();
    setTimeout(open, RETRY_MS);
  };
  socket = next;
}

export function startStream(): void {
  open();
  // Status arrives twice a second: long silence means a dead connection that TCP has not noticed yet.
  setInterval(() => {
    if (socket?.readyState === WebSocket.OPEN && heardMs > 0 && performance.now() - heardMs > SILENCE_MS) {
      lose();
      socket.close();
    }
  }, RETRY_MS);
}
