// Sends the one-time form of a page that somebody is looking at. A page that is only fetched or prerendered sends nothing.
"use strict";
const form = document.getElementById("one-time");
const submitWhenSeen = () => {
  if (form && !document.prerendering && document.visibilityState === "visible") form.submit();
};
if (document.prerendering) document.addEventListener("prerenderingchange", submitWhenSeen, { once: true });
document.addEventListener("visibilitychange", submitWhenSeen, { once: true });
submitWhenSeen();
