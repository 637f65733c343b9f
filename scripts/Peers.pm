# Peers.pm: what scripts/peers does beside comparing: which packages are there, the small programs
# of tests/peers built, commands measured, tables.
package Peers;
use strict;
use warnings;
use File::Basename qw(basename);
use JSON::PP ();

# Who is compared with: the Debian packages, and how the small program of its name is linked, if it
# has one.
my %peer = (
    cgal          => { name => 'CGAL', packages => [qw(libcgal-dev libgmp-dev libmpfr-dev libeigen3-dev)], flags => '-frounding-math -isystem /usr/include/eigen3', libs => '-lmpfr -lgmp' },
    meshoptimizer => { name => 'meshoptimizer', packages => ['libmeshoptimizer-dev'], libs => '-lmeshoptimizer' },
    openvdb       => { name => 'OpenVDB', packages => [qw(libopenvdb-dev libimath-dev)], libs => '-lopenvdb -ltbb -lImath-3_1' },
    open3d        => { name => 'Open3D', packages => ['libopen3d-dev'], flags => '-isystem /usr/include/eigen3', libs => '-lOpen3D -lfmt -ltbb' },
    pcl           => { name => 'PCL', packages => ['pcl-tools'] },
    meshlab       => { name => 'MeshLab', packages => [qw(meshlab xvfb xauth)] },
    cloudcompare  => { name => 'CloudCompare', packages => ['cloudcompare'] },
);
sub packages { return map { @{ $peer{$_}{packages} } } sort keys %peer }

sub new {
    my ($class, %self) = @_;
    my $self = bless { %self, have => {}, tables => [], rows => [] }, $class;
    mkdir "$self->{build}/peers";
    return $self;
}

# ---- who is there ----

# Whether a library or program can be compared with; says so, once, if not. '' is nobody's.
sub have {
    my ($self, $who) = @_;
    return 1 if $who eq '';
    return $self->{have}{$who} //= do {
        my @missing = grep { `dpkg-query -W -f '\${db:Status-Status}' $_ 2>/dev/null` ne 'installed' } @{ $peer{$who}{packages} };
        my $ok = !@missing && (!exists $peer{$who}{libs} || $self->program($who));
        if (@missing) { $self->say("skipped: $peer{$who}{name}: package $missing[0] is not installed") }
        elsif (!$ok) { $self->say("skipped: $peer{$who}{name}: tests/peers/$who.cpp could not be built") }
        $ok ? 1 : 0;
    };
}
sub path { my ($self, $name) = @_; return "$self->{build}/peers/$name" }

# Builds programs of tests/peers that are older than their sources.
sub program {
    my ($self, @names) = @_;
    for my $name (@names) {
        my ($source) = grep { -e } "tests/peers/$name.cpp", "tests/peers/$name.c";
        my $to = $self->path($name);
        next if -e $to && !grep { -M $_ < -M $to } $source, glob('tests/peers/*.hpp'), $name eq 'scene' ? "$self->{build}/libformats.a" : ();
        print STDERR "peers: building $source\n";
        my $libs = $peer{$name}{libs} // ($name eq 'scene' ? "$self->{build}/libformats.a $self->{build}/libcore.a -lm -ldl -pthread" : '');
        my $compiler = $source =~ /\.c$/ ? "cc -std=c11 -D_GNU_SOURCE" : 'c++ -std=c++17';
        my $flags = $peer{$name}{flags} // '';
        my $said = `$compiler -O2 -I. $flags -o '$to.new' $source $libs 2>&1`;
        if ($?) { print STDERR $said; unlink "$to.new"; return 0 }
        rename "$to.new", $to or die "$to: $!\n";
    }
    return 1;
}

# ---- commands ----

sub run {
    my ($self, $command) = @_;
    my $said = `{ $command; } 2>$self->{work}/said`;
    return $said unless $?;
    my $status = $? >> 8;
    open my $f, '<', "$self->{work}/said" or die "$command: status $status\n";
    my @lines = <$f>;
    die(($lines[-1] // "status $status") =~ s/\s*\z/\n/r);
}
sub json {
    my ($self, $file) = @_;
    open my $f, '<', $file or die "$file: $!\n";
    local $/;
    return JSON::PP::decode_json(<$f>);
}
sub json_run { my ($self, $command, $file) = @_; $self->run($command); return $self->json($file) }

# The command run once: its CPU seconds and memory. A display that it needs is no part of it, nor
# is `before`, another command.
sub spend_once {
    my ($self, $command, $before) = @_;
    $self->run($before) if defined $before;
    my $cost = "$self->{work}/cost";
    my $display = $command =~ s/^(xvfb-run -a )// ? $1 : '';
    my $said = `$display@{[$self->path('spend')]} $self->{limit} $cost $command 2>&1`;
    my $status = $? >> 8;
    die "more than $self->{limit} CPU s\n" if $status == 75;
    my ($why) = reverse grep { /\S/ } split /\n/, $said;
    die(($why // "status $status") . "\n") if $status;
    open my $f, '<', $cost or die "$cost: $!\n";
    my ($cpu, $bytes) = split ' ', <$f>;
    return { cpu => $cpu, mib => $bytes / 2**20 };
}
# Commands one after the other, each the best of several runs; [COMMAND, BEFORE] is one, too.
sub spend {
    my ($self, @commands) = @_;
    my ($cpu, $mib) = (0, 0);
    for my $command (@commands) {
        my $best;
        for (1 .. $self->{best}) {
            my $c = $self->spend_once(ref $command ? @$command : $command);
            $best = $c if !$best || $c->{cpu} < $best->{cpu};
            last if $best->{cpu} > 2;
        }
        $cpu += $best->{cpu};
        $mib = $best->{mib} if $best->{mib} > $mib;
    }
    return { cpu => $cpu || 1e-6, mib => $mib };
}

# The length for which count(length) is n, within a per cent or as near as seven tries come.
sub fit {
    my ($self, $n, $length, $count) = @_;
    my ($best, $off, @before) = ($length, 9**9**9);
    for (1 .. 7) {
        my $k = $count->($length) || 1;
        my $log = log($k / $n);
        ($best, $off) = ($length, abs $log) if abs $log < $off;
        last if $off < 0.01;
        # Points on a surface: as the square of the length, until two tries say better.
        my $slope = -2;
        $slope = ($log - $before[1]) / log($length / $before[0]) if @before && $length != $before[0];
        $slope = -2 unless $slope < -0.5 && $slope > -6;
        @before = ($length, $log);
        $length *= exp(-$log / $slope);
    }
    return $best;
}

my %meshlab = (
    'Poisson-disk Sampling' => [[Int => SampleNum => 1000], [AbsPerc => Radius => 0], [Int => MontecarloRate => 20], [Bool => SaveMontecarlo => 'false'], [Bool => ApproximateGeodesicDistance => 'false'],
        [Bool => Subsample => 'false'], [Bool => RefineFlag => 'false'], [Mesh => RefineMesh => 0], [Bool => BestSampleFlag => 'true'], [Int => BestSamplePool => 10], [Bool => ExactNumFlag => 'false'], [Float => RadiusVariance => 1]],
    'Simplification: Quadric Edge Collapse Decimation' => [[Int => TargetFaceNum => 1000], [Float => TargetPerc => 0], [Float => QualityThr => 0.3], [Bool => PreserveBoundary => 'false'], [Float => BoundaryWeight => 1],
        [Bool => PreserveNormal => 'false'], [Bool => PreserveTopology => 'false'], [Bool => OptimalPlacement => 'true'], [Bool => PlanarQuadric => 'false'], [Float => PlanarWeight => 0.001], [Bool => QualityWeight => 'false'], [Bool => AutoClean => 'true'], [Bool => Selected => 'false']],
);
# The command for a filter of MeshLab, which wants all parameters in their order.
sub meshlab {
    my ($self, $from, $to, $filter, %set) = @_;
    my $script = "$self->{work}/script.mlx";
    open my $f, '>', $script or die "$script: $!\n";
    print $f qq(<!DOCTYPE FilterScript>\n<FilterScript>\n<filter name="$filter">\n);
    print $f qq(<Param type="Rich$_->[0]" name="$_->[1]" value="@{[$set{$_->[1]} // $_->[2]]}" min="0" max="1e9"/>\n) for @{ $meshlab{$filter} };
    print $f "</filter>\n</FilterScript>\n";
    close $f or die "$script: $!\n";
    return "xvfb-run -a env -u QT_QPA_PLATFORM meshlabserver -i $from -o $to -s $script";
}
sub cloudcompare {
    my ($self, $from, $to, $what) = @_;
    return "CloudCompare -SILENT -AUTO_SAVE OFF -O $from -C_EXPORT_FMT PLY $what -SAVE_CLOUDS FILE $to";
}

# ---- what is printed ----

# In lines of at most 104 letters, as they are pasted.
sub wrapped {
    my ($text) = @_;
    my @lines = ('');
    for my $word (split / /, $text) {
        push @lines, '' if length($lines[-1]) && length($lines[-1]) + 1 + length($word) > 104;
        $lines[-1] .= (length $lines[-1] ? ' ' : '') . $word;
    }
    return join "\n", @lines;
}
sub say { my ($self, @text) = @_; print "@text\n"; STDOUT->flush }
sub failed { my ($self, $name, $why) = @_; chomp $why; return { way => $name, gives => "failed: $why" } }

sub title {
    my ($self, $date) = @_;
    my ($cpu) = map { /^model name\s*:\s*(.*)/ ? $1 : () } do { open my $f, '<', '/proc/cpuinfo' or (); <$f> };
    my ($kernel) = `uname -sr` =~ /^(\S+ \d+(?:\.\d+)*)/;
    chomp(my $cores = `nproc`);
    $self->{caption} = "$date, $cores cores of " . ($cpu // 'an unknown processor') . ", $kernel; each program on one processor";
    $self->say(wrapped("$self->{caption}, CPU seconds the least of $self->{best} run" . ($self->{best} == 1 ? '' : 's (of one if above 2)') . ', memory resident at most.'));
}

sub cell {
    my ($value, $format) = @_;
    return '' unless defined $value;
    return $format && $value =~ /^-?[\d.]+(e[-+]?\d+)?$/i ? sprintf($format, $value) : $value;
}
# columns: [heading, member, format]; rows: hashes. In Markdown, aligned.
sub table {
    my ($self, $text, $columns, $rows) = @_;
    my @lines = ([map { $_->[0] } @$columns], map { my $r = $_; [map { cell($r->{ $_->[1] }, $_->[2]) } @$columns] } @$rows);
    push @{ $self->{tables} }, [$text, @lines];
    my @width = map { my $i = $_; (sort { $b <=> $a } map { length $_->[$i] } @lines)[0] } 0 .. $#$columns;
    my $line = sub { my $l = shift; '| ' . join(' | ', map { $columns->[$_][2] ? sprintf('%*s', $width[$_], $l->[$_]) : sprintf('%-*s', $width[$_], $l->[$_]) } 0 .. $#$columns) . ' |' };
    my $rule = '|' . join('|', map { $columns->[$_][2] ? '-' x ($width[$_] + 1) . ':' : '-' x ($width[$_] + 2) } 0 .. $#$columns) . '|';
    $self->say("\n" . wrapped($text) . "\n");
    $self->say($line->($lines[0]));
    $self->say($rule);
    $self->say($line->($_)) for @lines[1 .. $#lines];
}
sub tsv {
    my ($self, $file) = @_;
    open my $f, '>', $file or die "$file: $!\n";
    print $f "# $self->{caption}\n";
    for (@{ $self->{tables} }) {
        my ($text, @lines) = @$_;
        print $f "# $text\n", map({ join("\t", map { s/\\\|/|/gr } @$_) . "\n" } @lines);
    }
    close $f or die "$file: $!\n";
}

1;
