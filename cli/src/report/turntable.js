'use strict';
{
  const figure = document.querySelector('.turntable');
  const [still, canvas, controls, button, slider, output] =
    ['img', 'canvas', '.controls', 'button', 'input[type=range]', 'output'].map(what => figure.querySelector(what));
  const sides = [...figure.querySelectorAll('input[type=radio]')];
  const frames = slider.dataset.frames.split(' ');
  const load = bytes => new Promise((done, failed) => {
    const picture = new Image();
    picture.onload = () => done(picture);
    picture.onerror = () => failed(new Error('a picture of the turn-table cannot be read'));
    // The first is on the page already.
    picture.src = bytes === '-' ? still.src : 'data:image/png;base64,' + bytes;
  });
  const all = sides.map(side => Promise.all(side.dataset.pictures.split(' ').map(load)));
  Promise.all(all).then(pictures => {
    const pen = canvas.getContext('2d');
    let timer = 0;
    const show = () => {
      const side = Math.max(0, sides.findIndex(one => one.checked));
      const k = Number(slider.value);
      // All but the first picture of a side hold only what differs from it.
      pen.drawImage(pictures[side][0], 0, 0);
      if (k > 0) pen.drawImage(pictures[side][k], 0, 0);
      output.textContent = 'frame ' + frames[k];
      slider.setAttribute('aria-valuetext', output.textContent);
      canvas.setAttribute('aria-label', 'Frame ' + frames[k] + ' from ' + sides[side].value);
    };
    const pause = () => {
      clearInterval(timer);
      timer = 0;
      button.textContent = 'Play';
    };
    const next = () => {
      slider.value = (Number(slider.value) + 1) % frames.length;
      show();
    };
    button.addEventListener('click', () => {
      if (timer) return pause();
      timer = setInterval(next, 150);
      button.textContent = 'Pause';
      next();
    });
    slider.addEventListener('input', () => {
      pause();
      show();
    });
    sides.forEach(side => side.addEventListener('change', show));
    show();
    figure.classList.add('live');
    canvas.hidden = controls.hidden = false;
  });
}
