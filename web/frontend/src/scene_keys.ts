// The scene frame takes the keyboard while it has focus; its bridge script hands key presses over, and they act here.

import { press, releaseKey } from "./keys";

interface SceneMessage {
  type: "scene-key" | "scene-pointerup";
  phase?: "down" | "up";
  key?: string;
  ctrlKey?: boolean;
  shiftKey?: boolean;
  altKey?: boolean;
  metaKey?: boolean;
  repeat?: boolean;
}

export function listenForScene(): void {
  window.addEventListener("message", (event: MessageEvent<SceneMessage>) => {
    if (event.origin !== location.origin || event.data?.type !== "scene-key") return;
    const { phase, key = "", ctrlKey = false, shiftKey = false, repeat = false, altKey, metaKey } = event.data;
    if (phase === "up") releaseKey(key);
    else if (!altKey && !metaKey) press({ key, ctrlKey, shiftKey, repeat });
  });
}
