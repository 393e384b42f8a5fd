// What is scrolled sideways can be reached with the keyboard, and the two side bars have names.
addEventListener("load", () => {
  for (const part of document.querySelectorAll("pre, .table-wrapper, .math-wrapper, .cell_output")) {
    if (part.scrollWidth > part.clientWidth) part.tabIndex = 0;
  }
  document.querySelector(".sidebar-drawer")?.setAttribute("aria-label", "Pages");
  document.querySelector(".toc-drawer")?.setAttribute("aria-label", "On this page");
});
