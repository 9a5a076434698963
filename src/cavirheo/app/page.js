// Light always; and what gradio's own parts lack for who listens to the page, or has no mouse.
() => {
  document.body.classList.remove('dark');
  let last = null;
  document.addEventListener('focusin', (event) => { last = event.target; });
  const mended = () => {
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
  mended();
  const watched = {childList: true, subtree: true, attributeFilter: ['aria-label', 'style', 'class', 'disabled']};
  new MutationObserver(() => requestAnimationFrame(mended)).observe(document.body, watched);
}
