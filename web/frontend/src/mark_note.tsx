// M: a note into the recording.

import type { JSX } from "preact";
import { useEffect, useRef, useState } from "preact/hooks";
import { send } from "./api";
import { Key } from "./controls";
import { say } from "./store";

export function MarkNote(): JSX.Element | null {
  const [open, setOpen] = useState(false);
  const field = useRef<HTMLInputElement>(null);
  useEffect(() => {
    const show = (): void => setOpen(true);
    window.addEventListener("mark-event", show);
    return () => window.removeEventListener("mark-event", show);
  }, []);
  useEffect(() => {
    if (open) field.current?.focus();
  }, [open]);
  if (!open) return null;
  const mark = (): void => {
    const note = field.current?.value.trim() ?? "";
    if (note === "") return;
    setOpen(false);
    void send({ type: "mark_event", note }).then((answer) => answer.accepted && say("advisory", `Marked: ${note}`));
  };
  return (
    <aside class="panel mark-note" data-testid="mark-note" aria-label="Mark event">
      <label>Note<input ref={field} class="field text" data-testid="mark-note-text" maxLength={200}
        onKeyDown={(e) => { if (e.key === "Enter") mark(); if (e.key === "Escape") setOpen(false); }} /></label>
      <Key testid="mark-note-send" primary onAct={mark}>Mark event</Key>
      <Key testid="mark-note-cancel" onAct={() => setOpen(false)}>Cancel</Key>
    </aside>
  );
}
