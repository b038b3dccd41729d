// The event log: newest first, repeats collapsed, cleared alerts keep their shape and lose their colour.

import type { JSX } from "preact";
import { isOpen, openCount } from "../alerts";
import { Key, Mark } from "../controls";
import { clock } from "../format";
import { useClock } from "../frame_loop";
import { toggleSound } from "../sound";
import { type LoggedEvent, state, useStore } from "../store";

const SHOWN = 120;

function label(event: LoggedEvent, open: boolean): string {
  if (event.acknowledged && event.level !== "advisory") return "acknowledged";
  if (open || event.level === "advisory") return event.level;
  return "cleared";
}

export function EventRows({ events, now }: { events: LoggedEvent[]; now: number }): JSX.Element {
  return (
    <ul class="events" data-testid="event-log">
      {events.slice(0, SHOWN).map((event) => {
        const open = isOpen(event, now);
        return (
          <li key={event.id} class={open ? event.level : "cleared"}>
            <Mark level={event.level} cleared={!open} />
            <time>{clock(event.utc_s)}</time>
            <span class="text" title={`${event.source}${event.who ? `, ${event.who}` : ""}`}>
              {event.text}{event.who && !event.text.includes(event.who) && <span class="who"> {event.who}</span>}{event.count > 1 && ` (${event.count} times)`}
            </span>
            <span class="level">{label(event, open)}</span>
          </li>
        );
      })}
    </ul>
  );
}

export function SoundKey(): JSX.Element {
  const sound = useStore((s) => s.sound);
  const text = sound === "blocked" ? "Sound blocked, click to allow" : sound === "on" ? "Sound on" : "Sound off";
  return <Key testid="sound" onAct={toggleSound}>{text}</Key>;
}

export function AlertsBody(): JSX.Element {
  const now = useClock(1000);
  useStore((s) => s.events);
  return (
    <div class="scroll" tabIndex={0}>
      {state.events.length === 0
        ? <p class="empty"><b>Nothing logged yet.</b>Alerts, commands with who gave them, and refusals appear here as they happen.</p>
        : <EventRows events={state.events} now={now} />}
    </div>
  );
}

export function AlertsPanel(): JSX.Element {
  const now = useClock(1000);
  return (
    <section class="panel alerts">
      <header class="head">
        <h2>Alerts</h2>
        <span class="right">{openCount(state, now)} open, {state.events.length} logged <SoundKey /></span>
      </header>
      <AlertsBody />
    </section>
  );
}
