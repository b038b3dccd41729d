// The live stream: hello, then binary frames and JSON. Reconnects each second; the backlog in each hello refills the gap.

import { log, seedEvents } from "./alerts";
import type { Hello, StationEvent, Status } from "./protocol";
import { ring } from "./ring";
import { state, update } from "./store";

const RETRY_MS = 1000;
const SILENCE_MS = 3000;
const PROBE_MS = 2000;

type Message = Hello | ({ type: "status" } & Status) | ({ type: "event" } & StationEvent) | { type: "watchers"; names: string[] };

let socket: WebSocket | null = null;
let heardMs = 0;

function lose(): void {
  if (state.station !== "lost") update({ station: "lost", stationLostMs: performance.now() });
}

function read(text: string): void {
  const message = JSON.parse(text) as Message;
  switch (message.type) {
    case "hello":
      ring.layout(message.signals, message.frame_size);
      update({ station: "live", stationLiveMs: performance.now(), watchers: message.watchers, ...(message.status ? { status: message.status, statusMs: performance.now() } : {}) });
      seedEvents(message.events);
      break;
    case "status":
      update({ status: message, statusMs: performance.now() });
      break;
    case "event":
      log(message);
      break;
    case "watchers":
      update({ watchers: message.names });
      break;
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

// A silent stream is either a dead connection that TCP has not noticed yet, or a station with nothing to say: ask it.
async function probe(): Promise<void> {
  try {
    const answer = await fetch("/api/session", { signal: AbortSignal.timeout(PROBE_MS), credentials: "same-origin" });
    if (answer.ok) return;
  } catch (error) {
    if (!(error instanceof DOMException || error instanceof TypeError)) throw error;
  }
  lose();
  socket?.close();
}

export function startStream(): void {
  open();
  setInterval(() => {
    if (socket?.readyState === WebSocket.OPEN && heardMs > 0 && performance.now() - heardMs > SILENCE_MS) void probe();
  }, RETRY_MS);
}
