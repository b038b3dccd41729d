// Worker: tells the station that the holder of the controls is still there. A thread of its own, because the scene shares
// the page's thread and may stall it for seconds while it starts; a page that hangs for longer still loses the controls.

const KEEP_MS = 1500;
const PAGE_SILENT_MS = 10_000;

export interface KeeperOrder {
  csrf: string;
  holding: boolean;
}

let order: KeeperOrder = { csrf: "", holding: false };
let heardMs = 0;

self.onmessage = (event: MessageEvent<KeeperOrder>) => {
  order = event.data;
  heardMs = performance.now();
};

async function keep(): Promise<void> {
  if (!order.holding || performance.now() - heardMs > PAGE_SILENT_MS) return;
  try {
    await fetch("/api/commands", {
      method: "POST",
      credentials: "same-origin",
      headers: { "Content-Type": "application/json", "X-CSRF-Token": order.csrf },
      body: JSON.stringify({ type: "keep_controls" }),
      signal: AbortSignal.timeout(2 * KEEP_MS),
    });
  } catch (error) {
    // No connection: the page says so itself, and the station takes the controls back.
    if (!(error instanceof TypeError || error instanceof DOMException)) throw error;
  }
}

setInterval(() => void keep(), KEEP_MS);
