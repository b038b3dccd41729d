// Runs inside the scene's page. The theme is the dashboard's. Keys pressed while the scene has the focus belong to the dashboard, safety keys above all:
// they are handed to the parent, and viser's own keys stay off. Letting go of the pointer gives the focus back.
"use strict";
(() => {
  if (window.parent === window) return;
  const origin = window.location.origin;
  const dashboard = window.parent.document.documentElement;
  const takeTheme = () => {
    document.documentElement.dataset.theme = dashboard.dataset.theme ?? "dark";
  };
  takeTheme();
  new MutationObserver(takeTheme).observe(dashboard, { attributeFilter: ["data-theme"] });
  const forward = (phase) => (event) => {
    event.stopImmediatePropagation();
    if (["Tab", "F5", "F11", "F12"].includes(event.key)) return;
    if (!event.ctrlKey && !event.metaKey && !event.altKey) event.preventDefault();
    window.parent.postMessage(
      {
        type: "scene-key",
        phase,
        key: event.key,
        code: event.code,
        ctrlKey: event.ctrlKey,
        shiftKey: event.shiftKey,
        altKey: event.altKey,
        metaKey: event.metaKey,
        repeat: event.repeat,
      },
      origin,
    );
  };
  window.addEventListener("keydown", forward("down"), true);
  window.addEventListener("keyup", forward("up"), true);
  // Once the user turns or zooms the picture it is theirs: the dashboard is told, and the camera stops following.
  const taken = () => window.parent.postMessage({ type: "scene-taken" }, origin);
  let from = null;
  window.addEventListener("pointerdown", (event) => { from = [event.clientX, event.clientY]; }, true);
  window.addEventListener(
    "pointermove",
    (event) => {
      if (from === null || event.buttons === 0) return;
      if (Math.hypot(event.clientX - from[0], event.clientY - from[1]) < 3) return;
      from = null;
      taken();
    },
    true,
  );
  window.addEventListener("wheel", taken, { capture: true, passive: true });
  window.addEventListener("pointerup", () => {
    window.parent.focus();
    window.parent.postMessage({ type: "scene-pointerup" }, origin);
  });
})();
