// Wide tables scroll; who has no mouse reaches them by the tabulator key. The theme wraps them late.
"use strict";

function reachable() {
  for (const wrap of document.querySelectorAll(".md-typeset__scrollwrap:not([tabindex])")) wrap.tabIndex = 0;
  document.querySelector("[data-md-component=search]:not([aria-label])")?.setAttribute("aria-label", "Search");
}

new MutationObserver(reachable).observe(document, { childList: true, subtree: true });
reachable();
