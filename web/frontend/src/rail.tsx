// View rail: seven views, keys 1 to 7.

import type { JSX } from "preact";
import { update, useStore, type ViewName } from "./store";

const ICONS: Record<ViewName, JSX.Element> = {
  fly: <><circle cx="12" cy="12" r="9" /><path d="M3.3 12.6H8a4 4 0 0 0 8 0h4.7" /></>,
  tune: <path d="M6 3v5M6 13v8M3.5 10.5h5M12 3v10M12 18v3M9.5 15.5h5M18 3v3M18 11v10M15.5 8.5h5" />,
  model: <path d="M3 8c3-4 5 3 8 0s6 2 10-1M3 13c3-3 5 2 8 0s6 2 10-1M3 18c3-3 5 2 8 0s6 2 10-1" />,
  identify: <path d="M3 20h18M3 12c4 0 5-6 9-6 2 0 3 12 8 13" />,
  estimate: <><ellipse cx="12" cy="12" rx="9.5" ry="6" transform="rotate(-20 12 12)" /><path d="M9 12h6M12 9v6" /></>,
  link: <><circle cx="5.5" cy="18.5" r="2.5" /><circle cx="18.5" cy="5.5" r="2.5" /><path d="m7.5 16.5 9-9" /></>,
  runs: <path d="M3 6h18M3 12h18M3 18h9M17 15l5 3-5 3z" />,
};

export const VIEW_TITLES: Record<ViewName, string> = {
  fly: "Fly", tune: "Tune", model: "Model error", identify: "Identify", estimate: "Estimate", link: "Link", runs: "Runs",
};

export function Rail(): JSX.Element {
  const view = useStore((s) => s.view);
  return (
    <nav class="rail" aria-label="Views">
      {(Object.keys(ICONS) as ViewName[]).map((name) => (
        <button type="button" key={name} data-testid={`rail-${name}`} aria-current={name === view ? "page" : undefined} onClick={() => update({ view: name })}>
          <svg viewBox="0 0 24 24" aria-hidden="true">{ICONS[name]}</svg>
          {VIEW_TITLES[name]}
        </button>
      ))}
    </nav>
  );
}
