//! Numbers to little-endian bytes and back, by one description for both ways.

/// The bytes end too early, or say something impossible.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Malformed;

/// Walks over values in a fixed order and either writes them or fills them in.
pub trait Codec {
    /// Eight bytes for one number.
    fn word(&mut self, v: &mut u64) -> Result<(), Malformed>;

    /// Whether values are being read.
    fn reading(&self) -> bool;

    /// The length of a list that follows, whose items take at least `size` bytes each.
    fn length(&mut self, len: usize, size: usize) -> Result<usize, Malformed>;

    fn size(&mut self, v: &mut usize) -> Result<(), Malformed> {
        let mut word = *v as u64;
        self.word(&mut word)?;
        *v = usize::try_from(word).map_err(|_| Malformed)?;
        Ok(())
    }

    fn float(&mut self, v: &mut f64) -> Result<(), Malformed> {
        let mut bits = v.to_bits();
        self.word(&mut bits)?;
        *v = f64::from_bits(bits);
        Ok(())
    }

    fn floats<const N: usize>(&mut self, list: &mut Vec<[f64; N]>) -> Result<(), Malformed>
    where
        Self: Sized,
    {
        self.list(list, 8 * N, [0.0; N], |c, row| row.iter_mut().try_for_each(|v| c.float(v)))
    }

    /// A list of items of at least `size` bytes; `blank` is what is filled in.
    fn list<T: Clone>(
        &mut self,
        list: &mut Vec<T>,
        size: usize,
        blank: T,
        item: impl Fn(&mut Self, &mut T) -> Result<(), Malformed>,
    ) -> Result<(), Malformed>
    where
        Self: Sized,
    {
        let len = self.length(list.len(), size)?;
        list.resize(len, blank);
        list.iter_mut().try_for_each(|v| item(self, v))
    }

    fn text(&mut self, text: &mut String) -> Result<(), Malformed>
    where
        Self: Sized,
    {
        let mut bytes: Vec<u64> = text.bytes().map(u64::from).collect();
        self.list(&mut bytes, 8, 0, |c, v| c.word(v))?;
        if self.reading() {
            let bytes = bytes.into_iter().map(u8::try_from).collect::<Result<Vec<u8>, _>>().map_err(|_| Malformed)?;
            *text = String::from_utf8(bytes).map_err(|_| Malformed)?;
        }
        Ok(())
    }
}

/// Writes.
#[derive(Default)]
pub struct Encoder {
    pub bytes: Vec<u8>,
}

impl Codec for Encoder {
    fn word(&mut self, v: &mut u64) -> Result<(), Malformed> {
        self.bytes.extend_from_slice(&v.to_le_bytes());
        Ok(())
    }

    fn reading(&self) -> bool {
        false
    }

    fn length(&mut self, len: usize, _size: usize) -> Result<usize, Malformed> {
        self.word(&mut (len as u64))?;
        Ok(len)
    }
}

/// Reads; lists are never longer than what is left of the bytes could hold.
pub struct Decoder<'a> {
    pub rest: &'a [u8],
}

impl Codec for Decoder<'_> {
    fn word(&mut self, v: &mut u64) -> Result<(), Malformed> {
        let (word, rest) = self.rest.split_first_chunk::<8>().ok_or(Malformed)?;
        *v = u64::from_le_bytes(*word);
        self.rest = rest;
        Ok(())
    }

    fn reading(&self) -> bool {
        true
    }

    fn length(&mut self, _len: usize, size: usize) -> Result<usize, Malformed> {
        let mut word = 0;
        self.word(&mut word)?;
        let len = usize::try_from(word).map_err(|_| Malformed)?;
        if len.checked_mul(size).is_none_or(|bytes| bytes > self.rest.len()) { Err(Malformed) } else { Ok(len) }
    }
}
