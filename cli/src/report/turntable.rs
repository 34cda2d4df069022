//! The turntable of a page: pictures of several frames from several sides, one visible at a time.

use std::fmt::Write as _;

use super::html::{base64, escape};

/// Frames of a run from several sides, with a slider.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Turntable {
    /// Caption below the picture.
    pub caption: String,
    /// Indices of the frames.
    pub frames: Vec<usize>,
    /// At least one side.
    pub sides: Vec<Side>,
    /// Width and height of all pictures \[px\].
    pub size: [u32; 2],
}

/// The pictures from one side.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Side {
    /// Name of the view, such as "from the front".
    pub name: String,
    /// A PNG of the first frame, and an overlay for each other frame, from
    /// [`pliant_render::to_overlays`].
    pub pictures: Vec<Vec<u8>>,
}

/// The script of the slider and the pictures; equal for all pages. The pictures are attributes of
/// the page.
const SCRIPT: &str = include_str!("turntable.js");

/// The part of a page's policy that permits only this script: its SHA-256.
pub(super) const POLICY: &str =
    "; script-src 'sha256-FUl91pgzIWxCqmfZ/0BSFbd0o4DCSlkMIDuHvhO62DU='";

/// Without the script and on paper only the first picture is visible.
pub(super) const STYLE: &str = "\
.turntable{display:grid;grid-template-columns:minmax(0,1fr);padding:0;overflow:hidden}
.turntable img,.turntable canvas{display:block;width:100%;height:auto;background:#fff}
.turntable.live img,.turntable.live .still,.turntable:not(.live) .moving,.turntable [hidden]{display:none}
.controls{display:flex;flex-wrap:wrap;gap:12px;align-items:center;padding:14px;border-top:1px solid var(--line)}
.controls button{font:inherit;color:inherit;background:var(--page);border:1px solid var(--line);border-radius:8px;\
min-width:76px;padding:6px 12px;cursor:pointer}
.controls input[type=range]{flex:1 1 100px;min-width:0;margin:0;accent-color:var(--soft)}
.controls output{min-width:84px;font-variant-numeric:tabular-nums}
.controls fieldset{display:flex;flex-wrap:wrap;gap:0 14px;border:0;margin:0;padding:0;min-width:0;width:100%}
.controls legend{float:left;padding:4px 0;color:var(--soft)}
.controls label{display:flex;gap:6px;align-items:center;padding:4px 0;cursor:pointer}
.controls input[type=radio]{margin:0;accent-color:var(--soft)}
@media(max-width:480px){.controls legend{width:100%}}
@media screen and (min-width:960px){.turntable{grid-template:1fr auto/minmax(0,640px) minmax(0,1fr)}\
.turntable img,.turntable canvas{grid-area:1/1/3/2}.controls{grid-area:1/2;align-content:start;border-top:0}\
.turntable figcaption{grid-area:2/2;border-top:0}}
@media print{.turntable{max-width:480px}.turntable canvas,.turntable .controls,.turntable .moving{display:none!important}\
.turntable.live img{display:block}.turntable.live .still{display:inline}}
";

impl Turntable {
    /// Appends the section; nothing without pictures.
    pub(super) fn write(&self, html: &mut String) {
        let Some((side, first)) = self
            .sides
            .first()
            .and_then(|side| Some((side, side.pictures.first()?)))
        else {
            return;
        };
        let ([width, height], last) = (self.size, self.frames.len().saturating_sub(1));
        let frame = self.frames.first().copied().unwrap_or(0);
        let still = format!("Frame {frame} from {}", escape(&side.name));
        let numbers: Vec<String> = self.frames.iter().map(usize::to_string).collect();
        let _ = write!(
            html,
            "<h2>Frame by frame</h2>\n<figure class=\"card turntable\">\n\
             <img alt=\"{still}\" width=\"{width}\" height=\"{height}\" src=\"data:image/png;base64,{}\">\n\
             <canvas role=\"img\" width=\"{width}\" height=\"{height}\" hidden></canvas>\n\
             <div class=\"controls\" hidden>\n<button type=\"button\">Play</button>\n\
             <input type=\"range\" aria-label=\"Frame\" min=\"0\" max=\"{last}\" step=\"1\" value=\"0\" \
             autocomplete=\"off\" data-frames=\"{}\">\n\
             <output>frame {frame}</output>\n<fieldset>\n<legend>Seen from</legend>\n",
            base64(first),
            numbers.join(" ")
        );
        for (number, side) in self.sides.iter().enumerate() {
            // A picture that is already on the page is not repeated.
            let known = |k: usize| number == 0 && k == 0;
            let picture = |(k, bytes): (usize, &Vec<u8>)| {
                if known(k) {
                    "-".to_owned()
                } else {
                    base64(bytes)
                }
            };
            let pictures: Vec<String> = side.pictures.iter().enumerate().map(picture).collect();
            let (name, checked) = (
                escape(&side.name),
                if number == 0 { " checked" } else { "" },
            );
            let _ = writeln!(
                html,
                "<label><input type=\"radio\" name=\"side\" value=\"{name}\" autocomplete=\"off\"{checked} \
                 data-pictures=\"{}\"> {name}</label>",
                pictures.join(" ")
            );
        }
        let _ = write!(
            html,
            "</fieldset>\n</div>\n<figcaption><span class=\"still\">{still}</span><span class=\"moving\">{}</span></figcaption>\n</figure>\n\
             <script>{SCRIPT}</script>\n",
            escape(&self.caption)
        );
    }
}

#[cfg(test)]
mod tests {
    use super::super::Report;
    use super::*;

    /// The integer part of the `degree`-th root of a number, by bisection.
    fn root(number: u128, degree: u32) -> u128 {
        let (mut low, mut high) = (0u128, 1 << 42);
        while high - low > 1 {
            let middle = (low + high) / 2;
            if middle
                .checked_pow(degree)
                .is_some_and(|power| power <= number)
            {
                low = middle
            } else {
                high = middle
            }
        }
        low
    }

    /// SHA-256 (FIPS 180-4), its constants from the roots of the first primes.
    fn sha256(bytes: &[u8]) -> [u8; 32] {
        let primes: Vec<u128> = (2..312u128)
            .filter(|n| (2..*n).all(|d| n % d != 0))
            .collect();
        assert_eq!(primes.len(), 64);
        let cubic: Vec<u32> = primes.iter().map(|p| root(p << 96, 3) as u32).collect();
        let mut hash: [u32; 8] = std::array::from_fn(|k| root(primes[k] << 64, 2) as u32);
        let mut padded = bytes.to_vec();
        padded.push(0x80);
        padded.resize((bytes.len() + 9).next_multiple_of(64) - 8, 0);
        padded.extend((8 * bytes.len() as u64).to_be_bytes());
        for block in padded.as_chunks::<64>().0 {
            let mut w: Vec<u32> = block
                .as_chunks()
                .0
                .iter()
                .map(|word| u32::from_be_bytes(*word))
                .collect();
            let turned =
                |x: u32, by: [u32; 3]| by.iter().fold(0, |sum, by| sum ^ x.rotate_right(*by));
            for t in 16..64 {
                let [a, b] = [(w[t - 15], [7, 18], 3), (w[t - 2], [17, 19], 10)]
                    .map(|(x, [p, q], shift)| x.rotate_right(p) ^ x.rotate_right(q) ^ (x >> shift));
                w.push(
                    w[t - 16]
                        .wrapping_add(a)
                        .wrapping_add(w[t - 7])
                        .wrapping_add(b),
                );
            }
            let mut v = hash;
            for t in 0..64 {
                let [a, b, c, d, e, f, g, h] = v;
                let choice = (e & f) ^ (!e & g);
                let one = [turned(e, [6, 11, 25]), choice, cubic[t], w[t]]
                    .iter()
                    .fold(h, |s, x| s.wrapping_add(*x));
                let two = turned(a, [2, 13, 22]).wrapping_add((a & b) ^ (a & c) ^ (b & c));
                v = [one.wrapping_add(two), a, b, c, d.wrapping_add(one), e, f, g];
            }
            hash.iter_mut()
                .zip(v)
                .for_each(|(h, v)| *h = h.wrapping_add(v));
        }
        std::array::from_fn(|k| hash[k / 4].to_be_bytes()[k % 4])
    }

    #[test]
    fn the_policy_names_the_script() {
        // The examples of the standard.
        let hex = |bytes: &[u8]| {
            sha256(bytes)
                .iter()
                .map(|b| format!("{b:02x}"))
                .collect::<String>()
        };
        assert_eq!(
            hex(b"abc"),
            "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"
        );
        let long = hex(b"abcdbcdecdefdefgefghfghighijhijkijkljklmklmnlmnomnopnopq");
        assert_eq!(
            long,
            "248d6a61d20638b8e5c026930c3e6039a33ce45964ff2167f6ecedd419db06c1"
        );
        let policy = |script: &str| {
            format!(
                "; script-src 'sha256-{}'",
                base64(&sha256(script.as_bytes()))
            )
        };
        assert_eq!(
            POLICY,
            policy(SCRIPT),
            "after a change of the script the policy has to be this"
        );
        assert_ne!(POLICY, policy(&format!("{SCRIPT} ")), "control");
    }

    fn table() -> Turntable {
        let side = |name: &str, pictures: [&[u8]; 2]| Side {
            name: name.to_owned(),
            pictures: pictures.map(<[u8]>::to_vec).to_vec(),
        };
        Turntable {
            caption: "\"><script>alert(1)</script>".to_owned(),
            frames: vec![0, 8],
            sides: vec![
                side("the <front>", [b"a", b"b"]),
                side("\"behind\"", [b"c", b"d"]),
            ],
            size: [4, 3],
        }
    }

    #[test]
    fn one_picture_is_on_the_page_and_the_others_are_kept_beside() {
        let html = Report {
            turntable: Some(table()),
            ..Report::default()
        }
        .to_html();
        assert_eq!(html.matches("data:image/png;base64,YQ==\"").count(), 1);
        assert_eq!(
            html.matches("YQ==").count(),
            1,
            "the first picture is kept once"
        );
        assert!(
            html.contains("data-pictures=\"- Yg==\"")
                && html.contains("data-pictures=\"Yw== ZA==\"")
        );
        assert!(html.contains("data-frames=\"0 8\"") && html.contains("max=\"1\""));
        assert!(
            html.contains("value=\"the &lt;front&gt;\"")
                && html.contains("value=\"&quot;behind&quot;\"")
        );
        assert!(html.contains(POLICY) && html.contains(STYLE));
        // One script, that of the turntable, and nothing that ends it early.
        assert_eq!(
            (
                html.matches("<script").count(),
                html.matches("</script").count()
            ),
            (1, 1)
        );
        assert!(
            html.contains(&format!("<script>{SCRIPT}</script>"))
                && html.contains("&lt;script&gt;alert")
        );
        for word in [
            "http:",
            "https:",
            "url(",
            "@import",
            "<link",
            "href",
            " src=\"http",
        ] {
            assert!(!html.contains(word), "{word}");
        }
    }

    #[test]
    fn a_page_without_one_runs_nothing() {
        for turntable in [None, Some(Turntable::default())] {
            let html = Report {
                turntable,
                ..Report::default()
            }
            .to_html();
            assert!(!html.contains("<script") && !html.contains("<figure"));
        }
        assert!(!Report::default().to_html().contains("script-src"));
    }
}
