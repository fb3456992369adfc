// Charts and tables that are wider than a phone can be scrolled sideways: the page shows that there is more, and where.

for (const frame of document.querySelectorAll(".chart, .wide")) {
  const hint = document.createElement("p");
  hint.className = "more screen-only";
  frame.after(hint);
  const look = () => {
    const rest = frame.scrollWidth - frame.clientWidth;
    const [left, right] = [rest > 1 && frame.scrollLeft > 1, rest > 1 && frame.scrollLeft < rest - 1];
    frame.classList.toggle("more-left", left);
    frame.classList.toggle("more-right", right);
    hint.textContent = rest > 1 ? `${left ? "← " : ""}scroll sideways${right ? " →" : ""}` : "";
    if (rest > 1) frame.tabIndex = 0; // keys scroll it, too
    else frame.removeAttribute("tabindex");
  };
  frame.addEventListener("scroll", look, { passive: true });
  new ResizeObserver(look).observe(frame);
  look();
}
