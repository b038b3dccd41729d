// Views whose instruments come later: what will appear, why it is empty, what to use now.

import type { JSX } from "preact";

const TEXTS = {
  model: {
    title: "Model error",
    lead: "No model error estimator is running.",
    text: "Six channels of measured minus model acceleration in their guaranteed bounds, the consistency δ, the path error with and without compensation, and each channel's share of its limit appear here. This station has no compensator yet: the strip says Off.",
  },
  identify: {
    title: "Identify",
    lead: "No sweep yet.",
    text: "The response from a sweep to the measured motion appears here as magnitude, phase and coherence, with a verdict that says accept or refuse and the number that decided. This station cannot fly a sweep yet. To see a response now, fly a step on the Fly view and compare it on Tune.",
  },
} as const;

export function Empty({ name }: { name: keyof typeof TEXTS }): JSX.Element {
  const { title, lead, text } = TEXTS[name];
  return (
    <section class="panel whole" data-testid={`empty-${name}`}>
      <header class="head"><h2>{title}</h2></header>
      <p class="empty"><b>{lead}</b>{text}</p>
    </section>
  );
}
