// Use the light theme always; correct gradio's components for users of a screen reader or of the keyboard alone.
() => {
  document.body.classList.remove('dark');
  let last = null;
  document.addEventListener('focusin', (event) => { last = event.target; });
  const correctPage = () => {
    for (const one of document.querySelectorAll('#upload button[aria-label]')) {
      if (one.innerText.trim()) one.removeAttribute('aria-label');
    }
    for (const one of document.querySelectorAll('.select-all-checkbox:not([aria-label])')) {
      one.setAttribute('aria-label', 'All shots');
    }
    const gone = last && (!last.isConnected || !last.offsetParent || last.disabled);
    if (gone && (document.activeElement === document.body || document.activeElement === last)) {
      document.querySelector('#steps [role=tab][aria-selected=true]')?.focus({preventScroll: true});
    }
  };
  correctPage();
  const watched = {childList: true, subtree: true, attributeFilter: ['aria-label', 'style', 'class', 'disabled']};
  new MutationObserver(() => requestAnimationFrame(correctPage)).observe(document.body, watched);
}
