// The page: strip, rail, view, bar. The Fly view stays mounted, so that its scene does not start anew at every change of view.

import type { JSX } from "preact";
import { Bar } from "./bar";
import { KeySheet } from "./key_sheet";
import { MarkNote } from "./mark_note";
import { Rail } from "./rail";
import { useStore } from "./store";
import { Strip } from "./strip";
import { Empty } from "./views/empty";
import { EstimateView } from "./views/estimate";
import { FlyView } from "./views/fly";
import { LinkView } from "./views/link";
import { RunsView } from "./views/runs";
import { TuneView } from "./views/tune";

function Other(): JSX.Element | null {
  const view = useStore((s) => s.view);
  switch (view) {
    case "fly": return null;
    case "tune": return <TuneView />;
    case "estimate": return <EstimateView />;
    case "link": return <LinkView />;
    case "runs": return <RunsView />;
    case "model": return <Empty name="model" />;
    case "identify": return <Empty name="identify" />;
  }
}

export function Frame(): JSX.Element {
  const view = useStore((s) => s.view);
  return (
    <div id="frame">
      <Strip />
      <Rail />
      <main class="view" data-testid={`view-${view}`}>
        <FlyView hidden={view !== "fly"} />
        <Other />
        <KeySheet />
        <MarkNote />
      </main>
      <Bar />
    </div>
  );
}
