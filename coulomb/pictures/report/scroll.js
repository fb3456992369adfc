// Charts and tables wider than the screen can be scrolled sideways; the page indicates where there is more.

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
    if (rest > 1) frame.tabIndex = 0; // scrollable by keys as well
    else frame.removeAttribute("tabindex");
  };
  frame.addEventListener("scroll", look, { passive: true });
  new ResizeObserver(look).observe(frame);
  look();
}
